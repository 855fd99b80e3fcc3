"""Cameras refined from a flame's images, where the truth, or a camera left out, can judge.

12 cameras in a ring, alternately from above and below, turbulent flame, 2 % noise. In the
disturbed rigs every camera is shifted and turned at random; ray-miss is that of the rig against
the true one over the volume, in pixels, and wanted is less than 0.1 after, or that nothing found
is accepted where the rig is right. `plume` is ScalarFlow's, where `--data` has it: each camera
predicted from the four others, PSNR in dB, the cameras that carry an average field of view refined
on the first frame; the camera that is predicted takes no part and stays as it was given.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import rigs
from rigs import box_points, ray_miss
from studies.benchmark.plume import LOWER, SCAN, UPPER
from studies.common.poses import disturbed
from studies.common.scans import reconstructed, simulated_by
from studies.common.study import Progress, Request, Tables
from tomo import VoxelGrid, load_scan

VIEWS, NOISE = 12, 0.02
ERROR = 0.35
"""Standard deviation, in pixels, of what each of a camera's three shifts and three turns moves its
image by: lines of sight then miss each other by more than half a pixel."""

NOMINAL = ("cam00", "cam04")
"""The plume's cameras whose field of view is an average."""

POINTS = 5  # along each side of the volume, where ray-miss is judged
SEEDS = 6

COLUMNS = {
    "disturbed_rigs": "seed before_pixels after_pixels accepted seconds",
    "true_rigs": "seed before_pixels after_pixels accepted seconds",
}


def run(request: Request) -> Tables:
    """Refine rigs that are wrong, rigs that are right, and the plume's."""
    full, progress = request.size == "full", request.progress
    seeds = range(request.seed + 1, request.seed + 1 + (SEEDS if full else 1))
    tables: Tables = {
        "disturbed_rigs": rigs_refined(seeds, progress, error=ERROR, tiny=not full),
        "true_rigs": rigs_refined(seeds, progress, error=0.0, tiny=not full),
    }
    if full and request.data is not None and (request.data / SCAN).is_file():
        tables["plume"] = plume(request.data, progress)
    return tables


def rigs_refined(
    seeds: Iterable[int], progress: Progress, *, error: float, tiny: bool = False
) -> list[dict[str, Any]]:
    """Return ray-miss before and after refining rigs whose poses are so wrong, a row a seed."""
    grid = VoxelGrid((16, 40, 16), 0.8) if tiny else VoxelGrid((30, 140, 30), 0.5)
    size, footprint = ((40, 64), 0.6) if tiny else ((100, 200), 0.4)
    true = rigs.ring(
        VIEWS,
        distance=400,
        image_size=size,
        footprint=footprint,
        pitch_degrees=[12, -12] * (VIEWS // 2),
    )
    rows, seeds = [], list(seeds)
    for number, seed in enumerate(seeds):
        progress(number, len(seeds), f"poses {error:g} px wrong, seed {seed}")
        scan = simulated_by(true, grid, ("turbulent", seed), supersample=3, noise=NOISE, seed=seed)
        given = disturbed(true, grid, seed, error)
        wrong = replace(scan, rig=given)
        began = time.perf_counter()
        found = reconstructed(wrong, grid, refine_cameras="all", method="sirt", iterations=2)
        seconds = time.perf_counter() - began
        rig = found.refined_rig or given
        points = box_points(grid.lower, grid.upper, POINTS)
        before, after = (ray_miss(true, one, points) / footprint for one in (given, rig))
        rows.append(
            {
                "seed": seed,
                "before_pixels": before,
                "after_pixels": after,
                "accepted": found.refinement["accepted"],
                "seconds": seconds,
            }
        )
    return rows


def plume(folder: Path, progress: Progress) -> list[dict[str, Any]]:
    """Return how well each camera of the plume is predicted from the four others.

    A row a camera; the rig refined on the first frame is judged on it and on the second.
    """
    scan = load_scan(folder / SCAN)
    cameras = (
        replace(camera, status="nominal" if camera.name in NOMINAL else "calibrated")
        for camera in scan.rig
    )
    scan = replace(scan, rig=replace(scan.rig, cameras=tuple(cameras)))
    grid = VoxelGrid.from_bounds((64, 96, 64), LOWER, UPPER)
    first, second = scan.frame_names[:2]
    rows = []
    for number, name in enumerate(scan.rig.names):
        progress(number, len(scan.rig), f"plume without {name}")
        chosen = [camera for camera in NOMINAL if camera != name]
        how = {"hold_out": [name], "peak": 1.0}
        found = reconstructed(scan.scaled(6), grid, frame=first, refine_cameras=chosen, **how)
        rig = found.refined_rig or scan.rig
        held = tuple(scan.rig[name] if camera.name == name else camera for camera in rig)
        again = replace(scan, rig=replace(rig, cameras=held)).scaled(6)
        row: dict[str, Any] = {"held_out": name, "refined": " ".join(chosen)}
        for frame in (first, second):
            given = reconstructed(scan.scaled(6), grid, frame=frame, **how)
            refined = found if frame == first else reconstructed(again, grid, frame=frame, **how)
            row[f"{frame}_given"] = given.report()["held_out"][name]["psnr"]
            row[f"{frame}_refined"] = refined.report()["held_out"][name]["psnr"]
        rows.append(row)
    return rows
