"""The default against the truth, as a user meets it, beside the best that could be had.

Images are simulated through voxels four times as fine. The default chooses basis, smoothness,
stop and effects without the truth; `voxel` is the default with the voxel basis. `best classical`
is the nearest to the truth of sixteen classical methods and settings, stopped by the truth, which
no user can do. Seconds are from images in memory to the volume; those of the whole include the
intervals. Means over the seeds.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from typing import Any

from studies.benchmark.convergence import CLASSIC, convergence_of, in_linear_basis, means
from studies.benchmark.sizes import SIZES
from studies.common.flames import NOISES, RIGS, Scene, scene
from studies.common.scans import problem, reconstructed, seconds_of
from studies.common.study import Request, Tables
from studies.scenes.scene import warm_up
from tomo import metrics
from tomo.operators import LINEAR, VOXEL

REFINE = 4
"""Voxels of the simulation along an edge of the grid's: images of twice finer ones show their
edges, and blur as much as a quarter of what voxels do."""

SEEDS = 2


def run(request: Request) -> Tables:
    """Return a row a flame, number of views and noise."""
    warm_up()
    sizes = SIZES[request.size]
    finer = replace(sizes.shown, refine=REFINE)
    cases = itertools.product(sizes.seeds[:SEEDS], sizes.flames, RIGS, NOISES)
    rows = [
        _row(scene(flame, views, noise, seed, finer), sizes.passes)
        for seed, flame, views, noise in request.each(cases, "accuracy, {0[1]}, {0[2]}".format)
    ]
    return {"accuracy": means(rows, "flame", "views", "noise")}


def _row(shown: Scene, passes: int) -> dict[str, Any]:
    busy = time.process_time()
    outcome = reconstructed(shown.scan, seed=shown.seed)
    busy = time.process_time() - busy
    voxel = reconstructed(shown.scan, seed=shown.seed, basis=VOXEL, uncertainty=0)
    truth = shown.truth
    ready = problem(shown.rig, shown.grid, shown.images, skip=True)
    problems = {VOXEL: ready, LINEAR: in_linear_basis(ready)}
    found = convergence_of(problems, truth, CLASSIC, passes)
    best = min(found, key=lambda name: found[name].least)
    return shown.named | {
        "cosine_distance": metrics.cosine_distance(outcome.volume, truth),
        "nrmse": metrics.nrmse(outcome.volume, truth),
        "seconds": seconds_of(outcome),
        "whole_seconds": outcome.seconds["total"],
        "whole_cpu_seconds": busy,
        "voxel_cosine_distance": metrics.cosine_distance(voxel.volume, truth),
        "best_classical": best,
        "best_classical_cosine_distance": found[best].least,
    }
