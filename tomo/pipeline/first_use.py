"""Compile or load the kernels that a reconstruction needs, and say how long that took."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from rigs import ring
from rigs.progress import Progress
from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import carve
from tomo.inference.solve import first_fit
from tomo.inference.steps import exact_images
from tomo.measurement import NoiseModel
from tomo.model import Observation
from tomo.operators import STORED, Projector
from tomo.operators.absorption import transmission
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.rays import Rays
from tomo.trace import trace


def warm_up(tracer: str, form: str = STORED) -> float:
    """Trace and project two rays through some voxels; return the seconds that it took."""
    started = time.perf_counter()
    grid = VoxelGrid((17, 17, 17), 1.0)  # so many that they are sorted by bricks
    active = ActiveVoxels(grid, np.arange(1, grid.size))
    (camera,) = ring(1, distance=50.0, image_size=(2, 1), footprint=1.0)
    rays = Rays.from_camera(camera)
    if form == STORED:
        for midpoints in (False, True):
            segments = trace(rays, grid, tracer, midpoints=midpoints, active=active)
            projector = Projector(segments, grid, active=active)
        transmission(segments, rays, grid, 0.0, 0.0, None)
    else:
        projector = OnTheFlyProjector(rays, grid, active=active)
    norm(projector.row_sums)
    for dtype in (np.float32, np.float64):
        norm(projector.T @ (projector @ np.ones(active.size, dtype)))
    return time.perf_counter() - started


def warm_up_stages(tracer: str, *, carving: bool, progress: Progress | None = None) -> float:
    """Warm up the stages that will be used; return the seconds that it took."""
    steps: dict[str, Callable[[], object]] = {
        "tracing": partial(warm_up, tracer),
        "inference": _warm_up_inference,
        **({"carving": _warm_up_carving} if carving else {}),
    }
    started = time.perf_counter()
    for number, (name, warm) in enumerate(steps.items()):
        if progress:
            progress(number, len(steps), name)
        warm()
    return time.perf_counter() - started


def _warm_up_carving() -> None:
    seen = _spots()
    carve(tuple(seen.rig), seen.images, None, seen.grid)


def _warm_up_inference() -> None:
    """Fit three small views, and draw a null of them."""
    seen = _spots()
    exact_images(seen, first_fit(seen).means, 0)


def _spots() -> Observation:
    """Return what three small views see of a spot."""
    rig = ring(3, distance=50.0, image_size=(15, 15), footprint=1.0)
    place = np.linspace(-3, 3, 15)
    spot = np.exp(-(place**2) - place[:, None] ** 2).astype(np.float32)  # no hot pixel: as wide
    mask, noise = np.ones(spot.shape, bool), NoiseModel(0.01, 0.0)
    return Observation(rig, (spot,) * 3, (mask,) * 3, (noise,) * 3, VoxelGrid((8, 8, 8), 1.0))
