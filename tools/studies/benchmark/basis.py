"""The voxel basis against the linear one: emission constant in voxels, or linear between centres.

Images are simulated through voxels four times as fine. The default, which chooses and stops
without the truth, by either basis, pixels weighted by their noise; "stopped" is the best classic
method of either, where it is nearest to the truth. Means over the seeds.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.benchmark.classic import CLASSIC, convergence_of, in_linear_basis
from studies.benchmark.sizes import SIZES
from studies.common.flames import NOISES, RIGS, Scene, scene
from studies.common.problems import Problem, problem
from studies.common.study import Request, Tables
from tomo import metrics
from tomo.measurement import estimate_noise
from tomo.operators import LINEAR, VOXEL
from tomo.pipeline.basis import BLOCK
from tomo.pipeline.build import weigh_images
from tomo.pipeline.solve import voxel_means_of
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen

REFINE = 4
"""Voxels of the simulation along an edge of the grid's: images of twice finer ones show their
edges, and blur as much as a quarter of what voxels do."""

SEEDS = 2

COLUMNS = {
    "basis": "flame views noise seeds stopped stopped_cosine_distance "
    "voxel_cosine_distance voxel_nrmse voxel_seconds linear_cosine_distance linear_nrmse "
    "linear_seconds linear_of_voxel linear_of_stopped",
}


def run(request: Request) -> Tables:
    """Return a row a flame, number of views and noise."""
    sizes = SIZES[request.size]
    finer = replace(sizes.shown, refine=REFINE)
    cases = [*itertools.product(sizes.seeds[:SEEDS], sizes.flames, RIGS, NOISES)]
    rows = []
    for number, (seed, flame, views, noise) in enumerate(cases):
        request.progress(number, len(cases), f"basis, {flame}, {views} views, {noise}")
        rows.append(_row(scene(flame, views, noise, seed, finer), sizes.passes))
    return {"basis": _means(rows)}


def _row(shown: Scene, passes: int) -> dict[str, Any]:
    scan = shown.scan
    ready = problem(scan.rig, scan.grid, shown.images, skip=True)
    by_linear = in_linear_basis(ready)
    found = convergence_of({VOXEL: ready, LINEAR: by_linear}, scan.truth, CLASSIC, passes)
    best = min(found, key=lambda name: found[name].least)
    started = time.perf_counter()
    weights = _weights(shown, ready)
    weighing = time.perf_counter() - started
    row = shown.named | {
        "stopped": best,
        "stopped_cosine_distance": found[best].least,
    }
    row |= _default("voxel", ready, weights, scan.truth, weighing)
    return row | _default("linear", by_linear, weights, scan.truth, weighing)


def _weights(shown: Scene, ready: Problem) -> NDArray[np.float32] | None:
    """Return what pixels weigh, as in reconstructions; None where all count alike."""
    masks = [np.ones(image.shape, np.bool_) for image in shown.images]
    noise = [estimate_noise(image) for image in shown.images]
    found = weigh_images(shown.scan.rig, shown.scan.grid, shown.images, masks, noise)
    return None if found.images is None else ready.system.flatten(found.images)


def _default(
    name: str,
    ready: Problem,
    weights: NDArray[np.float32] | None,
    truth: NDArray[np.float32],
    before: float,
) -> dict[str, Any]:
    """Return what the default comes to; ``before`` are seconds of weighing."""
    started, projector = time.perf_counter(), ready.system.projector
    blocks = ready.system.blocks(BLOCK)
    choice = choose_by_left_out_pixels(projector, ready.measured, blocks=blocks, weights=weights)
    found = solve_as_chosen(projector, ready.measured, choice, weights=weights)
    volume = voxel_means_of(projector, projector.active.compress(found.volume))
    return {
        f"{name}_cosine_distance": metrics.cosine_distance(volume, truth),
        f"{name}_nrmse": metrics.nrmse(volume, truth),
        f"{name}_seconds": ready.seconds + before + time.perf_counter() - started,
    }


def _means(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    groups: dict[tuple, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["flame"], row["views"], row["noise"]), []).append(row)
    found = []
    for (flame, views, noise), group in groups.items():
        mean = {"flame": flame, "views": views, "noise": noise, "seeds": len(group)}
        mean |= {
            key: statistics.fmean(row[key] for row in group)
            for key, value in group[0].items()
            if isinstance(value, float)
        }
        mean["stopped"] = " / ".join(dict.fromkeys(row["stopped"] for row in group))
        for name in ("stopped", "voxel"):
            ratio = mean["linear_cosine_distance"] / mean[f"{name}_cosine_distance"]
            mean[f"linear_of_{name}"] = ratio
        found.append(mean)
    return found
