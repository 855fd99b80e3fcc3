"""The report of a series: one HTML page with a film, the figures of every frame, and warnings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files import atomic_path
from rigs.progress import Progress
from tomo.draw.film.chart import COLOURS, Chart, chart
from tomo.draw.film.player import film_of
from tomo.draw.film.visualize import moments_of, shown_places, words_of
from tomo.draw.page import render
from tomo.report.facts import detail_tables, number_text, without_nulls
from tomo.series.answer import answer_of_series
from tomo.series.table import SeriesTable


def write_series_report(
    path: str | os.PathLike,
    table: SeriesTable,
    warnings: Sequence[str] = (),
    *,
    with_film: bool = True,
    progress: Progress | None = None,
) -> None:
    """Write the page, which loads nothing and stays under 20 MB however many frames there are.

    Parameters
    ----------
    path : path-like
        ``report.html``.
    table : SeriesTable
    warnings : sequence of str
    with_film : bool
        Whether volumes are shown, of `MOST_FRAMES` frames at the most.
    progress : callable, optional
    """
    store, film = table.store, None
    about = store.attributes
    shown = shown_places(store.complete)
    if with_film and shown:
        moments = moments_of(table, shown, progress)
        film = film_of(moments, store.grid, about["length_unit"], about["value_unit"])
    text = render(
        "series.html",
        title=f"Reconstruction of {store.n_frames} frames by {about['options']['method']}",
        answer=answer_of_series(table.columns, table.frames.tolist(), table.cameras),
        warnings=list(warnings),
        headline=_headline(table),
        words=words_of(shown, int(store.complete.sum())),
        film=film,
        charts=_charts(table, shown if film else ()),
        axis=_axis(table),
        table=_camera_table(table),
        details=detail_tables(without_nulls(_plan_details(about))),
    )
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _headline(table: SeriesTable) -> list[tuple[str, str, str]]:
    """Return the first figures: (value, name, what it means)."""
    complete, count = int((table.columns["complete"] == 1).sum()), table.store.n_frames
    rows = [(f"{complete:,}", "frames", "complete" if complete == count else f"of {count:,}")]
    for name, title, digits, unit in (
        ("psnr", "held-out PSNR", 4, " dB"),
        ("ssim", "held-out SSIM", 3, ""),
    ):
        for camera, values in table.each_camera(name).items():
            rows.append(
                (f"{np.nanmean(values):.{digits}g}{unit}", title, f"mean of {camera}, never used")
            )
    for name, title, words, form in (
        ("relative_residual", "relative residual", "mean of all frames", "{:.2%}"),
        ("total_emission", "total emission", table.store.group["total_emission"].attrs["units"],
         "{:.4g}"),
        ("seconds", "a frame", "to solve and compare", "{:.3g} s"),
    ):  # fmt: skip
        if len(values := table.known(name)):
            rows.append((form.format(values.mean()), title, words))
    voxels = table.store.attributes["plan"].get("active_voxels")
    if voxels:
        rows.append((number_text(voxels), "active voxels", "that key frames may light"))
    return rows


def _charts(table: SeriesTable, shown: Sequence[int]) -> list[Chart]:
    """Return the charts of the figures, those that the series has."""
    colours = {name: COLOURS[n % len(COLOURS)] for n, name in enumerate(table.cameras)}

    def alone(name: str, title: str) -> dict[str, NDArray]:
        return {title: table.columns[name]}

    emission = table.store.group["total_emission"].attrs["units"]
    found = [
        chart("Held-out PSNR", table.each_camera("psnr"), unit="dB", shown=shown, colours=colours),
        chart(
            "Relative residual",
            alone("relative_residual", "all that took part") | table.each_camera("view_residual"),
            shown=shown,
            from_zero=True,
            colours={"all that took part": "#1b2733"} | colours,
            digits=3,
        ),
        chart("Light over the plan's gain", table.each_camera("view_light"), shown=shown,
              colours=colours),
        chart("Total emission", alone("total_emission", ""), unit=emission, shown=shown,
              from_zero=True),
        chart("Seconds a frame", alone("seconds", ""), unit="s", shown=shown, from_zero=True,
              digits=3),
    ]  # fmt: skip
    return [one for one in found if one is not None]


def _axis(table: SeriesTable) -> tuple[str, str, str]:
    """Return the words below the charts: first, middle and last frame."""
    last = table.store.n_frames - 1
    return table.label(0), table.label(last // 2) if last > 1 else "", table.label(last)


def _camera_table(table: SeriesTable) -> dict[str, Any]:
    """Return a row a camera: means over the frames, and how the gain changed."""
    held_out = table.store.attributes["options"].get("hold_out") or []
    columns = (
        ("residual", "view_residual", np.nanmean, "{:.2%}"),
        ("beyond noise", "view_beyond_noise", np.nanmean, "{:.2%}"),
        ("gain", "view_gain", np.nanmean, "{:.3f}"),
        ("least gain", "view_gain", np.nanmin, "{:.3f}"),
        ("largest gain", "view_gain", np.nanmax, "{:.3f}"),
        ("PSNR (dB)", "psnr", np.nanmean, "{:.2f}"),
        ("least PSNR (dB)", "psnr", np.nanmin, "{:.2f}"),
        ("SSIM", "ssim", np.nanmean, "{:.3f}"),
    )
    kept = [one for one in columns if table.each_camera(one[1])]
    rows = []
    for name in table.cameras:
        values = [
            form.format(reduce(own)) if (own := table.each_camera(figure).get(name)) is not None
            else ""
            for _, figure, reduce, form in kept
        ]  # fmt: skip
        role = " (held out)" if name in held_out else ""
        rows.append((bool(role), [f"{name}{role}", *values]))
    return {"titles": ["Camera", *(title for title, *_ in kept)], "rows": rows}


def _plan_details(about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables at the end, as the report of one frame names them."""
    plan = about["plan"]
    keys = plan.get("key_frames")
    return {
        "basis": plan.get("basis"),
        "gains": plan.get("gains"),
        "carving": plan.get("carving"),
        "pixel_weights": plan.get("pixel_weights"),
        "alignment": plan.get("alignment"),
        "screening": plan.get("screening"),
        "solver": {"key frames": keys, **(plan.get("choice") or {})} if keys else None,
        "settings": about["options"],
        "versions": about.get("versions"),
    }
