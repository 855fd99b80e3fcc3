"""The store that ``flametomo reconstruct --frames`` writes: its checks and its summary."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tomo.cli.console import finite_or_none
from tomo.cli.outputs import check_output_folder
from tomo.series.store import CAMERA_FIGURES, SUFFIX

if TYPE_CHECKING:
    from rigs import Rig
    from tomo.series import SeriesStore


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


def series_report(store: SeriesStore) -> dict[str, Any]:
    """Return what is in a store, in numbers: ``--json``."""
    group, cameras = store.group, store.attributes["cameras"]
    views: dict[str, dict[str, float | None]] = {name: {} for name in cameras}
    for figure in CAMERA_FIGURES:
        values = group[figure][:]
        for name, column in zip(cameras, values.T, strict=True):
            known = column[np.isfinite(column)]
            if len(known):
                views[name][figure] = float(known.mean())
    known = {name: group[name][:] for name in ("relative_residual", "seconds", "warnings")}
    seconds = known["seconds"][np.isfinite(known["seconds"])]
    warned = int(np.count_nonzero(known["warnings"]))
    lines = list(store.attributes["plan_warnings"])
    if warned:
        lines.append(f"{warned} frames have warnings of their own: see the store's warnings")
    return {
        "store": str(store.path),
        "frames": store.n_frames,
        "complete": int(store.complete.sum()),
        "relative_residual": finite_or_none(float(np.nanmean(known["relative_residual"]))),
        "seconds_a_frame": float(seconds.mean()) if len(seconds) else None,
        "views": views,
        "held_out": {
            name: {figure: each[figure] for figure in ("psnr", "ssim") if figure in each}
            for name, each in views.items()
            if "psnr" in each
        },
        "plan": store.attributes["plan"],
        "warnings": lines,
    }


def series_summary(report: dict[str, Any]) -> str:
    """Return a line on each of: the frames, held-out cameras, the store."""
    lines = [
        f"{report['complete']} of {report['frames']} frames, mean relative residual "
        f"{report['relative_residual']:.4g}, {report['seconds_a_frame']:.2f} s a frame"
    ]
    for camera, figures in report["held_out"].items():
        shown = ", ".join(f"{name} {value:.4g}" for name, value in figures.items())
        lines.append(f"held out {camera}, mean: {shown}")
    lines.append(f"open {report['store']} with xarray.open_zarr, or export it: flametomo export")
    return "\n".join(lines)
