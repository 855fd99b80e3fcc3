"""What is in a store of frames, in numbers, and the report page beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rigs.progress import Progress, progress_of
from tomo.report.series_report import write_series_report
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

    Parameters
    ----------
    store : SeriesStore
    scan : Scan, optional
        What it was reconstructed from: says why frames that were left out could not be read.
    with_film : bool
        Whether the page shows volumes.
    progress : bool or callable, optional
        True shows a bar.

    Returns
    -------
    report : dict
        The figures of the series, see `series_report`; ``page`` is the path of the page.
    """
    table = SeriesTable.of(store)
    report = series_report(table)
    if scan is not None:
        report["warnings"] += _reasons_left_out(report["left_out"], scan)
    with progress_of(progress, "report") as tell:
        write_series_report(
            report["page"], table, report["warnings"], with_film=with_film, progress=tell
        )
    return report


def series_report(table: SeriesTable) -> dict[str, Any]:
    """Return what is in a store, in numbers: ``--json``."""
    about, columns = table.store.attributes, table.columns
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
        "store": str(table.store.path),
        "page": str(page_beside(table.store.path)),
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


def page_beside(store: Path) -> Path:
    """Return the report beside a store: Zarr's readers warn of files in it that are no arrays."""
    return store.with_name(f"{store.stem}_report.html")


def _reasons_left_out(frames: Sequence[int], scan: Scan) -> list[str]:
    """Return a line on each of a few frames that were left out: why they could not be read."""
    lines = []
    for place in frames[:MOST_REASONS]:
        try:
            read_frame(scan, place, skip_bad=False)
        except UnreadableError as error:
            lines.append(f"frame {error.frame}: {error.reason}")
    return lines
