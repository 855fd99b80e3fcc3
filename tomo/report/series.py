"""The report of a series: its figures, and a page with a film, charts and warnings."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from rigs.files.text import write_text
from rigs.progress import Progress, progress_of
from tomo.draw.chart import COLOURS, Chart, chart
from tomo.draw.film import film_of, moments_of, shown_places, words_of
from tomo.draw.page import render
from tomo.draw.scene import Scene
from tomo.draw.stage import stage
from tomo.pipeline.view import peak_in_words
from tomo.report.facts import (
    advice,
    detail_tables,
    number_text,
    short_unit,
    size_in_words,
    verdict_part,
    with_glossary,
    without_nulls,
)
from tomo.scan import Scan
from tomo.series import SeriesStore
from tomo.series.frames import UnreadableError, read_frame
from tomo.series.layout import CAMERA_FIGURES
from tomo.series.store import COMPLETE, LEFT_OUT
from tomo.series.verdict import SeriesTable, answer_of_series, verdict_of_series
from tomo.series.watching import in_words, watch

MOST_REASONS = 3
"""Frames left out of which the reason is said."""


def write_series_outcome(
    store: SeriesStore,
    scan: Scan | None = None,
    *,
    with_film: bool = True,
    progress: Progress | bool | None = None,
) -> dict[str, Any]:
    """Write the report page beside a store, as ``flametomo reconstruct --frames`` does.

    The ``scan`` that it was reconstructed from says why frames that were left out could not be
    read. The page shows volumes ``with_film``; ``progress`` True shows a bar. Returns the figures
    of the series, see `series_report`; ``page`` is the path of the page.
    """
    table = SeriesTable.of(store)
    report = series_report(table)
    if scan is not None:
        report["warnings"] += _reasons_left_out(report["left_out"], scan)
    with progress_of(progress, "report") as tell:
        lines = report["warnings"]
        write_series_report(report["page"], table, lines, with_film=with_film, progress=tell)
    return report


def series_report(table: SeriesTable) -> dict[str, Any]:
    """Return what is in a store, in numbers: ``--json``."""
    about, columns, path = table.store.attributes, table.columns, table.store.path
    views: dict[str, dict[str, float]] = {name: {} for name in table.cameras}
    for figure in CAMERA_FIGURES:
        for name, column in table.each_camera(figure).items():
            views[name][figure] = float(np.nanmean(column))
    found = watch(table.columns, table.frames, table.cameras)
    lines = [*about["plan_warnings"], *in_words(found)]
    if warned := int(np.count_nonzero(columns["warnings"])):
        lines.append(f"{warned} frames have warnings of their own: see the store's warnings")
    means = {
        name: float(values.mean()) if len(values := table.known(name)) else None
        for name in ("relative_residual", "seconds")
    }
    complete = columns["complete"]
    return {
        "answer": asdict(answer_of_series(columns, table.frames.tolist(), table.cameras)),
        "verdict": verdict_of_series(table),
        "store": str(path),
        # beside it: Zarr's readers warn of files in a store that are no arrays
        "page": str(path.with_name(f"{path.stem}_report.html")),
        "frames": table.store.n_frames,
        "complete": int((complete == COMPLETE).sum()),
        "left_out": table.frames[complete == LEFT_OUT].tolist(),
        "relative_residual": means["relative_residual"],
        "seconds_a_frame": means["seconds"],
        "quality": {
            name: float(values.mean())
            for name in ("nrmse", "cosine_distance")
            if len(values := table.known(name))
        },
        "views": views,
        "held_out": {
            name: {figure: each[figure] for figure in ("psnr", "ssim") if figure in each}
            for name, each in views.items()
            if "psnr" in each
        },
        "watched": [asdict(one) for one in found],
        "plan": about["plan"],
        "place": about.get("place"),
        "warnings": lines,
    }


def _reasons_left_out(frames: Sequence[int], scan: Scan) -> list[str]:
    """Return a line on each of a few frames that were left out: why they could not be read."""
    lines = []
    for place in frames[:MOST_REASONS]:
        try:
            read_frame(scan, place)
        except UnreadableError as error:
            lines.append(f"frame {error.frame}: {error.reason}")
    return lines


def write_series_report(
    path: str | os.PathLike,
    table: SeriesTable,
    warnings: Sequence[str] = (),
    *,
    with_film: bool = True,
    progress: Progress | None = None,
) -> None:
    """Write the page, which loads nothing and stays under 20 MB however many frames there are.

    With a film it shows the volumes of at most `tomo.draw.film.MOST_FRAMES` frames.
    """
    store, film = table.store, None
    about, last = store.attributes, store.n_frames - 1
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
        axis=(table.label(0), table.label(last // 2) if last > 1 else "", table.label(last)),
        table=_camera_table(table),
        details=detail_tables(without_nulls(_plan_details(about))),
    )
    write_text(path, with_glossary(text))


def _about(table: SeriesTable) -> str:
    """Return the line below the title: what was made of what, and how large it is."""
    about = table.store.attributes
    used = len(set(table.cameras) - set(about["options"].get("hold_out") or []))
    words = size_in_words(table.store.grid, about["length_unit"], used)
    return f"{words}, method {about['options']['method']}."


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
    emission = short_unit(table.store.unit("total_emission"))
    found = [
        chart("PSNR of the held-out camera, more is better", table.each_camera("psnr"), unit="dB",
              shown=shown, colours=colours),
        chart("Relative residual, less is better",
              {"all that took part": table.columns["relative_residual"]}
              | table.each_camera("view_residual"),
              shown=shown, from_zero=True, colours={"all that took part": "#1b2733"} | colours,
              digits=3),
        chart("Light of each camera over the volume's, 1 is right",
              table.each_camera("view_light"), shown=shown, colours=colours),
        chart("Total emission", {"": table.columns["total_emission"]}, unit=emission, shown=shown,
              from_zero=True),
        chart("Seconds a frame", {"": table.columns["seconds"]}, unit="s", shown=shown,
              from_zero=True, digits=3),
    ]  # fmt: skip
    return [one for one in found if one is not None]


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
