"""The store that ``flametomo reconstruct --frames`` writes: its checks and its summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomo.cli.outputs import check_output_folder
from tomo.series.store import CAMERA_FIGURES, COMPLETE, LEFT_OUT, SUFFIX

if TYPE_CHECKING:
    from rigs import Rig
    from tomo import Scan
    from tomo.series.table import SeriesTable

MOST_REASONS = 3
"""Frames left out of which the reason is said."""


def check_output_store(path: Path, rig: Rig, source: object) -> None:
    """Raise unless a store in the unit of a rig from ``source`` can be written there."""
    from tomo.io.volumes import check_length_unit

    if path.suffix != SUFFIX:
        raise ValueError(
            f"-o: found {str(path)!r}, expected a store like out{SUFFIX} with --frames"
        )
    if path.is_file():
        raise FileExistsError(f"{path}: is a file, expected a store to write")
    check_output_folder(path.parent)
    try:
        check_length_unit(rig.length_unit)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def reasons_left_out(frames: Sequence[int], scan: Scan) -> list[str]:
    """Return a line on each of a few frames that were left out: why they could not be read."""
    from tomo.series.images import UnreadableError, read_frame

    lines = []
    for place in frames[:MOST_REASONS]:
        try:
            read_frame(scan, place, skip_bad=False)
        except UnreadableError as error:
            lines.append(f"frame {error.frame}: {error.reason}")
    return lines


def series_report(table: SeriesTable) -> dict[str, Any]:
    """Return what is in a store, in numbers: ``--json``."""
    from tomo.series.answer import answer_of_series
    from tomo.series.watching import in_words, watch_table

    about, columns = table.store.attributes, table.columns
    views: dict[str, dict[str, float]] = {name: {} for name in table.cameras}
    for figure in CAMERA_FIGURES:
        for name, column in table.each_camera(figure).items():
            views[name][figure] = float(np.nanmean(column))
    found = watch_table(table)
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
        "store": str(table.store.path),
        "page": str(page_of(table.store.path)),
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
        "warnings": lines,
    }


def page_of(store: Path) -> Path:
    """Return the report beside a store: Zarr's readers warn of files in it that are no arrays."""
    return store.with_name(f"{store.stem}_report.html")


def series_summary(report: dict[str, Any]) -> str:
    """Return a line on each of: the frames, held-out cameras, the store."""
    figures = (
        ("relative_residual", "mean relative residual {:.4g}"),
        ("seconds_a_frame", "{:.2f} s a frame"),
    )
    known = [words.format(report[name]) for name, words in figures if report[name] is not None]
    lines = [", ".join([f"{report['complete']} of {report['frames']} frames", *known])]
    compared = {"against the truth": report["quality"]} if report["quality"] else {}
    compared |= {f"held out {camera}": each for camera, each in report["held_out"].items()}
    for name, figures in compared.items():
        shown = ", ".join(f"{figure} {value:.4g}" for figure, value in figures.items())
        lines.append(f"{name}, mean: {shown}")
    lines.append(
        f"open {report['page']}; {report['store']} opens with xarray.open_zarr, and flametomo "
        "export writes it for other programs"
    )
    return "\n".join(lines)
