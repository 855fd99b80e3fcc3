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
from tomo.draw.film.visualize import film_of, moments_of, shown_places, words_of
from tomo.draw.page import render
from tomo.draw.scene import Scene
from tomo.draw.stage import stage
from tomo.pipeline.view import peak_in_words
from tomo.report.facts import (
    advice,
    detail_tables,
    number_text,
    short_unit,
    verdict_part,
    without_nulls,
)
from tomo.report.glossary import with_glossary
from tomo.series.verdict import SeriesTable, answer_of_series, verdict_of_series


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
        own = film_of(moments_of(table, shown, progress), len(shown))
        film = stage(Scene(length_unit=about["length_unit"]), shown=own)
    text = render(
        "series.html",
        title=f"Reconstruction of {store.n_frames} frames",
        about=_about(table),
        verdict=verdict_part(verdict_of_series(table)),
        answer=answer_of_series(table.columns, table.frames.tolist(), table.cameras),
        warnings=[advice(line) for line in warnings],
        headline=_headline(table),
        words=words_of(shown, int(store.complete.sum())),
        film=film,
        charts=_charts(table, shown if film else ()),
        axis=_axis(table),
        table=_camera_table(table),
        details=detail_tables(without_nulls(_plan_details(about))),
    )
    with atomic_path(path) as temporary:
        temporary.write_text(with_glossary(text), encoding="utf-8")


def _about(table: SeriesTable) -> str:
    """Return the line below the title: what was made of what, and how large it is."""
    grid, about = table.store.grid, table.store.attributes
    size, voxels = (" × ".join(f"{n:.4g}" for n in values) for values in (grid.extent, grid.shape))
    used = len(set(table.cameras) - set(about["options"].get("hold_out") or []))
    return (
        f"Emission in {size} {about['length_unit']} ({voxels} voxels) from {used} camera"
        f"{'s' if used != 1 else ''}, method {about['options']['method']}."
    )


def _headline(table: SeriesTable) -> list[tuple[str, str, str]]:
    """Return the figures of the whole film: (value, name, what it means)."""
    complete, count = int((table.columns["complete"] == 1).sum()), table.store.n_frames
    said = "All are complete." if complete == count else f"Of {count:,}; the others are missing."
    rows = [(f"{complete:,}", "frames", said)]
    peak = table.store.attributes["plan"].get("peak")
    known = peak_in_words(peak) if peak else ""
    below, of = (f" below {known}", f" Peak {known}.") if known else ("", "")
    for name, title, digits, unit, words in (
        ("psnr", "PSNR", 4, " dB", f"Error of its predicted images{below}; 30 is good."),
        ("ssim", "SSIM", 3, "", f"Likeness of its predicted images, 1 at the most.{of}"),
    ):
        for camera, values in table.each_camera(name).items():
            value = f"{np.nanmean(values):.{digits}g}{unit}"
            rows.append((value, f"{camera} held out: {title}", words))
    unit = short_unit(table.store.unit("total_emission"))
    for name, title, words, form in (
        ("relative_residual", "relative residual", "Of the images, not reproduced, noise "
         "included; mean of all frames. Good: near the images' noise.", "{:.2%}"),
        ("total_emission", "total emission", "All light of the volume, mean of all frames.",
         f"{{:.4g}} {unit}"),
        ("seconds", "time a frame", "To solve and compare.", "{:.3g} s"),
    ):  # fmt: skip
        if len(values := table.known(name)):
            rows.append((form.format(values.mean()), title, words))
    voxels = table.store.attributes["plan"].get("active_voxels")
    if voxels:
        rows.append((number_text(voxels), "active voxels", "Not proved empty by dark pixels."))
    return rows


def _charts(table: SeriesTable, shown: Sequence[int]) -> list[Chart]:
    """Return the charts of the figures, those that the series has."""
    colours = {name: COLOURS[n % len(COLOURS)] for n, name in enumerate(table.cameras)}

    def alone(name: str, title: str) -> dict[str, NDArray]:
        return {title: table.columns[name]}

    emission = short_unit(table.store.unit("total_emission"))
    found = [
        chart(
            "PSNR of the held-out camera, more is better",
            table.each_camera("psnr"),
            unit="dB",
            shown=shown,
            colours=colours,
        ),
        chart(
            "Relative residual, less is better",
            alone("relative_residual", "all that took part") | table.each_camera("view_residual"),
            shown=shown,
            from_zero=True,
            colours={"all that took part": "#1b2733"} | colours,
            digits=3,
        ),
        chart(
            "Light of each camera over the volume's, 1 is right",
            table.each_camera("view_light"),
            shown=shown,
            colours=colours,
        ),
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
    """Return a row a camera: means over the frames, how the gain changed, and the words."""
    held_out = table.store.attributes["options"].get("hold_out") or []
    columns = (
        ("not reproduced", "view_residual", np.nanmean, "{:.2%}",
         "the part of its images that the volume does not reproduce, noise included"),
        ("beyond noise", "view_beyond_noise", np.nanmean, "{:.2%}",
         "the part that is neither volume nor noise: bad above 10 %"),
        ("gain", "view_gain", np.nanmean, "{:.3f}",
         "brightness of its images over the volume's: mean, least and largest; 1 is right"),
        ("least", "view_gain", np.nanmin, "{:.3f}", ""),
        ("largest", "view_gain", np.nanmax, "{:.3f}", ""),
        ("PSNR (dB)", "psnr", np.nanmean, "{:.2f}", "error of its prediction, mean and least"),
        ("least PSNR (dB)", "psnr", np.nanmin, "{:.2f}", ""),
        ("SSIM", "ssim", np.nanmean, "{:.3f}", "likeness of its prediction, 1 at the most"),
    )  # fmt: skip
    kept = [one for one in columns if table.each_camera(one[1])]
    rows = []
    for name in table.cameras:
        values = [
            form.format(reduce(own)) if (own := table.each_camera(figure).get(name)) is not None
            else ""
            for _, figure, reduce, form, _ in kept
        ]  # fmt: skip
        rows.append([f"{name} (held out)" if name in held_out else name, *values])
    return {
        "titles": ["Camera", *(title for title, *_ in kept)],
        "rows": rows,
        "marked": [n for n, name in enumerate(table.cameras) if name in held_out],
        "columns": [(title, words) for title, *_, words in kept if words],
    }


def _plan_details(about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables at the end, as the report of one frame names them."""
    plan = about["plan"]
    keys = plan.get("key_frames")
    return {
        "projector": {"device": about["place"]} if "place" in about else None,
        "basis": plan.get("basis"),
        "gains": plan.get("gains"),
        "carving": plan.get("carving"),
        "pixel_weights": plan.get("pixel_weights"),
        "screening": plan.get("screening"),
        "solver": {"key frames": keys, **(plan.get("choice") or {})} if keys else None,
        "settings": about["options"],
        "versions": about.get("versions"),
    }
