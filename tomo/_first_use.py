"""Compile or load the kernels that a reconstruction needs, and say how long that took."""

from __future__ import annotations

import time

import numpy as np

from rigs import ring
from tomo.grid import VoxelGrid
from tomo.on_the_fly import OnTheFlyProjector
from tomo.projector import Projector
from tomo.rays import Rays
from tomo.support import STORED, carve
from tomo.trace import trace


def warm_up(tracer: str, form: str = STORED) -> float:
    """Trace and project two rays through eight voxels; return the seconds that it took."""
    started = time.perf_counter()
    grid = VoxelGrid((2, 2, 2), 1.0)
    rays = Rays.from_lines([[-5, 0.5, 0.5], [-5, -0.5, 0.5]], [1.0, 0.0, 0.0])
    if form == STORED:
        for midpoints in (False, True):
            projector = Projector(trace(rays, grid, tracer, midpoints=midpoints), grid)
    else:
        projector = OnTheFlyProjector(rays, grid)
    for dtype in (np.float32, np.float64):
        projector.T @ (projector @ np.ones(8, dtype))
    return time.perf_counter() - started


def warm_up_carving() -> float:
    """Carve a grid of eight voxels by three small views; return the seconds that it took."""
    started = time.perf_counter()
    cameras = tuple(ring(3, distance=50.0, image_size=(9, 9), footprint=1.0))
    spot = np.zeros((9, 9), np.float32)
    spot[4, 4] = 1
    carve(cameras, [spot] * 3, None, VoxelGrid((2, 2, 2), 1.0))
    return time.perf_counter() - started
