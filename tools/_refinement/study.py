"""Cameras refined from a flame's images: nearer to the truth, and better at predicting others."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from _benchmark.plume import LOWER, SCAN, UPPER

import phantoms
import rigs
from rigs import Rig, box_points, ray_miss
from tomo import Scan, VoxelGrid
from tomo.pipeline import reconstruct
from tomo.selfcal.refine import refine_cameras
from tomo.selfcal.refine.parameters import COUNT, moved_rig
from tomo.selfcal.refine.prior import units
from tomo.simulation import simulate

VIEWS, NOISE = 12, 0.02
ERROR = 0.35
"""Standard deviation, in pixels, of what each of a camera's three shifts and three turns moves its
image by: lines of sight then miss each other by more than half a pixel."""

NOMINAL = ("cam00", "cam04")
"""The plume's cameras whose field of view is an average."""

POINTS = 5  # along each side of the volume, where ray-miss is judged

Say = Callable[[str], None]


def rigs_refined(
    seeds: Iterable[int], say: Say, *, error: float, tiny: bool = False
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
    rows = []
    for seed in seeds:
        say(f"poses {error:g} px wrong, seed {seed}")
        flame = phantoms.create("turbulent", extent=grid.extent, seed=seed)
        scan = simulate(true, flame, grid, supersample=3, refine=2, noise=NOISE, seed=seed)
        given = _disturbed(true, grid, seed, error)
        began = time.perf_counter()
        found = refine_cameras(given, list(scan.images.values()), grid)
        seconds = time.perf_counter() - began
        points = box_points(grid.lower, grid.upper, POINTS)
        before, after = (ray_miss(true, rig, points) / footprint for rig in (given, found.rig))
        rows.append(
            {
                "seed": seed,
                "before_pixels": before,
                "after_pixels": after,
                "accepted": found.accepted,
                "seconds": seconds,
            }
        )
    return rows


def plume(folder: Path, say: Say) -> list[dict[str, Any]]:
    """Return how well each camera of the plume is predicted from the four others, a row a camera.

    The nominal cameras are refined on the first frame; the camera that is predicted takes no part
    in that and stays as it was given. The rig is judged on the first frame and on the second.
    """
    if not (folder / SCAN).is_file():
        return []
    scan = Scan.load(folder / SCAN)
    cameras = (
        replace(camera, status="nominal" if camera.name in NOMINAL else "calibrated")
        for camera in scan.rig
    )
    scan = replace(scan, rig=replace(scan.rig, cameras=tuple(cameras)))
    grid = VoxelGrid.from_bounds((64, 96, 64), LOWER, UPPER)
    first, second = scan.frame_names[:2]
    rows = []
    for name in scan.rig.names:
        say(f"plume without {name}")
        chosen = [camera for camera in NOMINAL if camera != name]
        found = reconstruct(
            scan.scaled(6), grid, frame=first, hold_out=[name], refine_cameras=chosen
        )
        rig = found.refined_rig or scan.rig
        held = tuple(scan.rig[name] if camera.name == name else camera for camera in rig)
        again = replace(scan, rig=replace(rig, cameras=held))
        row: dict[str, Any] = {"held_out": name, "refined": " ".join(chosen)}
        for frame in (first, second):
            plain = reconstruct(scan.scaled(6), grid, frame=frame, hold_out=[name])
            refined = (
                found
                if frame == first
                else reconstruct(again.scaled(6), grid, frame=frame, hold_out=[name])
            )
            row[f"{frame} given"] = _psnr(plain, name)
            row[f"{frame} refined"] = _psnr(refined, name)
        rows.append(row)
    return rows


def _psnr(outcome: Any, name: str) -> float:
    return outcome.report()["held_out"][name]["psnr"]


def _disturbed(rig: Rig, grid: VoxelGrid, seed: int, error: float) -> Rig:
    """Return the rig with every camera shifted and turned at random, so many pixels each."""
    random = np.random.default_rng(seed)
    steps = np.zeros((len(rig), COUNT))
    for number, camera in enumerate(rig):
        steps[number, :6] = random.normal(size=6) * error * units(camera, grid)[:6]
    return moved_rig(rig, steps)
