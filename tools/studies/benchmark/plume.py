"""ScalarFlow's fog: each camera predicted from the four others by the default.

Left out where `--data` holds no `scalarflow` folder. Times are medians since the images were in
memory, choosing and tracing included.
"""

from __future__ import annotations

import itertools
import statistics
from pathlib import Path
from typing import Any

from studies.common.scans import reconstructed, seconds_of
from studies.common.study import Progress, Request, Tables
from tomo import Scan, VoxelGrid, load_scan

SCAN = Path("scalarflow") / "transforms.json"
JUDGED = "cam02"
"""The field's held-out camera: the only one that is also predicted without skipping."""

REPEATS = 3
"""Runs of each kind, with and without skipping in turn."""

LOWER, UPPER = (0.0818, -0.0446, -0.4958), (0.5727, 0.6917, -0.0049)

COLUMNS = {
    "plume": "frame held_out skip psnr ssim seconds trace_seconds solve_seconds segments "
    "live_voxels method",
}


def run(request: Request) -> Tables:
    """Return both frames' five leave-one-out views; with fewer sizes one frame's two."""
    if request.data is None or not (request.data / SCAN).is_file():
        return {"plume": []}
    return {"plume": plume(request.data, request.size == "full", request.progress)}


def plume(folder: Path, full: bool, progress: Progress) -> list[dict[str, Any]]:
    """Return a row a frame, camera and form of the plume in a folder."""
    scan = load_scan(folder / SCAN).scaled(6 if full else 12)
    grid = VoxelGrid.from_bounds((64, 96, 64) if full else (32, 48, 32), LOWER, UPPER)
    frames = scan.frame_names if full else scan.frame_names[-1:]
    cameras = scan.rig.names if full else [JUDGED, scan.rig.names[0]]
    cases = [
        (frame, camera, skip)
        for frame, camera in itertools.product(frames, cameras)
        for _ in range(REPEATS if full and camera == JUDGED else 1)
        for skip in ((True, False) if camera == JUDGED else (True,))
    ]
    runs: dict[tuple, list[dict[str, Any]]] = {}
    for number, case in enumerate(cases):
        progress(number, len(cases), f"plume, {case[0]} without {case[1]}")
        runs.setdefault(case, []).append(_predicted(scan, grid, *case))
    times = ("seconds", "trace_seconds", "solve_seconds")
    return [
        each[0] | {time: statistics.median(one[time] for one in each) for time in times}
        for each in runs.values()
    ]


def _predicted(scan: Scan, grid: VoxelGrid, frame: str, camera: str, skip: bool) -> dict[str, Any]:
    outcome = reconstructed(scan, grid, frame=frame, hold_out=[camera], skip=skip, peak=1.0)
    report = outcome.report()
    figures = {key: report["held_out"][camera][key] for key in ("psnr", "ssim", "cosine")}
    return {
        "frame": frame,
        "held_out": camera,
        "skip": skip,
        **figures,
        "seconds": seconds_of(outcome),
        "trace_seconds": outcome.seconds["trace"],
        "solve_seconds": outcome.seconds["solve"],
        "segments": outcome.counts["segments"],
        "live_voxels": outcome.counts["active_voxels"],
        "method": report["method"],
    }
