"""Cameras and gains found from a flame's images, where the truth, or a camera left out, can judge.

12 cameras in a ring, alternately from above and below, turbulent flame, 2 % noise. In the
disturbed rigs every camera is shifted and turned at random; ray-miss is that of the rig against
the true one over the volume, in pixels, and wanted is less than 0.1 after, or that nothing found
is accepted where the rig is right. `plume` is ScalarFlow's, where `--data` has it: each camera
predicted from the four others, PSNR in dB, the cameras that carry an average field of view refined
on the first frame; the camera that is predicted takes no part and stays as it was given. `gains`
has exact poses and sensitivities that differ by a standard deviation of 10 %, by the default: the
error of the worst camera's gain in per cent, and NRMSE beside that with equal cameras.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import rigs
from rigs import Rig, box_points, ray_miss
from studies.benchmark.plume import LOWER, SCAN, UPPER
from studies.common.scans import disturbed, reconstructed, simulated_by
from studies.common.study import Request, Tables
from tomo import VoxelGrid, load_scan
from tomo.simulation.effects import Effects

VIEWS, NOISE = 12, 0.02
ERROR = 0.35
"""Standard deviation, in pixels, of what each of a camera's three shifts and three turns moves its
image by: lines of sight then miss each other by more than half a pixel."""

NOMINAL = ("cam00", "cam04")  # the plume's cameras whose field of view is an average
GAIN_SEEDS = 2
POINTS = 5  # along each side of the volume, where ray-miss is judged
SEEDS = 4
SPREAD = 0.1
NOISES = (0.0, 0.005, 0.05)  # of the brightest pixel


def run(request: Request) -> Tables:
    """Refine rigs that are wrong, rigs that are right, and the plume's."""
    count, noises = (SEEDS, NOISES) if request.size == "full" else (1, NOISES[1:2])
    seeds = range(request.seed + 1, request.seed + 1 + count)
    tables: Tables = {
        "disturbed_rigs": rigs_refined(request, seeds, ERROR),
        "true_rigs": rigs_refined(request, seeds, 0.0),
        "gains": gains(request, seeds[:GAIN_SEEDS], noises),
    }
    if request.data is not None and (request.data / SCAN).is_file():
        tables["plume"] = plume(request, request.data)
    return tables


def rigs_refined(request: Request, seeds: Sequence[int], error: float) -> list[dict[str, Any]]:
    """Return ray-miss before and after refining rigs whose poses are so wrong, a row a seed."""
    true, grid, footprint = _seen(request)
    rows = []
    for seed in request.each(seeds, f"poses {error:g} px wrong, seed {{}}".format):
        scan = simulated_by(true, grid, ("turbulent", seed), supersample=3, noise=NOISE, seed=seed)
        given = disturbed(true, grid, seed, error)
        wrong = replace(scan, rig=given)
        began = time.process_time()
        found = reconstructed(wrong, grid, refine_cameras="all", method="sirt", iterations=2)
        seconds = time.process_time() - began
        rig = found.refined_rig or given
        points = box_points(grid.lower, grid.upper, POINTS)
        before, after = (ray_miss(true, one, points) / footprint for one in (given, rig))
        row = {"seed": seed, "before_pixels": before, "after_pixels": after}
        rows.append(row | {"accepted": found.refinement["accepted"], "cpu_seconds": seconds})
    return rows


def gains(request: Request, seeds: Sequence[int], noises: Sequence[float]) -> list[dict[str, Any]]:
    """Return how well the default finds gains, a row a noise: means over the seeds."""
    true, grid, _ = _seen(request)
    effects, rows = Effects(gain_spread=SPREAD), []
    for noise in request.each(noises, "gains, noise {:g}".format):
        found: dict[str, list[float]] = {"spread": [], "worst_error": []}
        for seed in seeds:
            how = {"supersample": 3, "noise": noise, "seed": seed}
            for name, has in (("nrmse_equal", None), ("nrmse", effects)):
                scan = simulated_by(true, grid, ("turbulent", seed), effects=has, **how)
                outcome = reconstructed(scan)
                found.setdefault(name, []).append(outcome.solution.quality["nrmse"])
            right = effects.gains(VIEWS, seed)
            fitted = np.ones(VIEWS)
            if outcome.gains is not None:
                fitted = np.array(list(outcome.report()["gains"]["gain"].values()))
            for name, ratio in (("spread", right), ("worst_error", fitted / right)):
                found[name].append(100 * float(np.abs(ratio / ratio.mean() - 1).max()))
        means = {name: statistics.fmean(values) for name, values in found.items()}
        rows.append({"noise": noise, "seeds": len(seeds)} | means)
    return rows


def _seen(request: Request) -> tuple[Rig, VoxelGrid, float]:
    """Return the true rig, the grid, and the width of a pixel."""
    tiny = request.size != "full"
    grid = VoxelGrid((16, 40, 16), 0.8) if tiny else VoxelGrid((30, 140, 30), 0.5)
    size, footprint = ((40, 64), 0.6) if tiny else ((100, 200), 0.4)
    pitch = [12, -12] * (VIEWS // 2)
    how = {"image_size": size, "footprint": footprint, "pitch_degrees": pitch}
    return rigs.ring(VIEWS, distance=400, **how), grid, footprint


def plume(request: Request, folder: Path) -> list[dict[str, Any]]:
    """Return how well each camera of the plume is predicted from the others, a row a frame too.

    The rig refined on the first frame is judged on it and on the second.
    """
    tiny = request.size != "full"
    scan = load_scan(folder / SCAN)
    cameras = (
        replace(camera, status="nominal" if camera.name in NOMINAL else "calibrated")
        for camera in scan.rig
    )
    scan = replace(scan, rig=replace(scan.rig, cameras=tuple(cameras)))
    shape, shrink = ((32, 48, 32), 12) if tiny else ((64, 96, 64), 6)
    grid = VoxelGrid.from_bounds(shape, LOWER, UPPER)
    first, second = scan.frame_names[:2]
    rows = []
    names = scan.rig.names[: 1 if tiny else None]
    for name in request.each(names, "plume without {}".format):
        chosen = [camera for camera in NOMINAL if camera != name]
        how = {"hold_out": [name], "peak": 1.0}
        found = reconstructed(scan.scaled(shrink), grid, frame=first, refine_cameras=chosen, **how)
        rig = found.refined_rig or scan.rig
        held = tuple(scan.rig[name] if camera.name == name else camera for camera in rig)
        again = replace(scan, rig=replace(rig, cameras=held)).scaled(shrink)
        for frame in (first, second):
            given = reconstructed(scan.scaled(shrink), grid, frame=frame, **how)
            refined = found if frame == first else reconstructed(again, grid, frame=frame, **how)
            psnr = [one.report()["held_out"][name]["psnr"] for one in (given, refined)]
            row = {"held_out": name, "refined": " ".join(chosen), "frame": frame}
            rows.append(row | {"given": psnr[0], "found": psnr[1]})
    return rows
