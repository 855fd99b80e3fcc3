"""A real plume, ScalarFlow's: each camera predicted from the four others, by the default."""

from __future__ import annotations

import itertools
import statistics
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from _benchmark.sizes import Sizes
from _benchmark.solvers import Progress, seconds_of
from tomo import Scan, VoxelGrid
from tomo.pipeline import reconstruct

SCAN = Path("scalarflow") / "transforms.json"
JUDGED = "cam02"
"""The field's held-out camera: the only one that is also predicted without skipping."""

REPEATS = 3
"""Of its runs, with and without skipping in turn."""

LOWER, UPPER = (0.0818, -0.0446, -0.4958), (0.5727, 0.6917, -0.0049)


@dataclass(frozen=True)
class Plume:
    """One camera of one frame, predicted.

    Attributes
    ----------
    frame, held_out : str
    skip : bool
    psnr, ssim, cosine : float
        Of the predicted image, against what the camera saw; intensities in 0..1.
    seconds : float
        Since the images were in memory, choosing and tracing included; a median, as are the next.
    trace_seconds, solve_seconds : float
    segments, active_voxels : int
    method : str
        What the default chose.
    """

    frame: str
    held_out: str
    skip: bool
    psnr: float
    ssim: float
    cosine: float
    seconds: float
    trace_seconds: float
    solve_seconds: float
    segments: int
    active_voxels: int
    method: str


def check_data(folder: Path) -> None:
    """Raise unless the folder holds the plume's scan and its images can be read."""
    if not (folder / SCAN).is_file():
        raise FileNotFoundError(f"--data: {folder / SCAN}: no such file, expected ScalarFlow's")
    scan = Scan.load(folder / SCAN)
    for frame in scan.frame_names:
        scan.read(frame)


def plume(folder: Path, sizes: Sizes, progress: Progress) -> list[dict[str, Any]]:
    """Return both frames' five leave-one-out views; with fewer sizes one frame's two."""
    full = sizes.name == "full"
    scan = Scan.load(folder / SCAN).scaled(6 if full else 12)
    grid = VoxelGrid.from_bounds((64, 96, 64) if full else (32, 48, 32), LOWER, UPPER)
    frames = scan.frame_names if full else scan.frame_names[-1:]
    cameras = scan.rig.names if full else [JUDGED, scan.rig.names[0]]
    cases = [
        (frame, camera, skip)
        for frame, camera in itertools.product(frames, cameras)
        for _ in range(REPEATS if full and camera == JUDGED else 1)
        for skip in ((True, False) if camera == JUDGED else (True,))
    ]
    runs: dict[tuple, list[Plume]] = {}
    for number, case in enumerate(cases):
        frame, camera, skip = case
        progress(number, len(cases), f"plume, {frame} without {camera}, skip {skip}")
        runs.setdefault(case, []).append(_predicted(scan, grid, *case))
    progress(len(cases), len(cases), "")
    return [asdict(_median(each)) for each in runs.values()]


def _predicted(scan: Scan, grid: VoxelGrid, frame: str, camera: str, skip: bool) -> Plume:
    outcome = reconstruct(scan, grid, frame=frame, hold_out=[camera], skip=skip)
    report = outcome.report()
    figures = report["held_out"][camera]
    return Plume(
        frame,
        camera,
        skip,
        figures["psnr"],
        figures["ssim"],
        figures["cosine"],
        seconds=seconds_of(outcome),
        trace_seconds=outcome.seconds["trace"],
        solve_seconds=outcome.seconds["solve"],
        segments=outcome.counts["segments"],
        active_voxels=outcome.counts["active_voxels"],
        method=report["method"],
    )


def _median(runs: list[Plume]) -> Plume:
    """Return runs that differ in their times alone as one."""
    times = ("seconds", "trace_seconds", "solve_seconds")
    return replace(
        runs[0], **{time: statistics.median(getattr(run, time) for run in runs) for time in times}
    )
