"""What rays do in a grid, before they are projected: which way, how much, and where."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._threads import share_out
from tomo.grid import VoxelGrid
from tomo.trace.courses import (
    ENTER,
    LEAVE,
    SLOPE_B,
    SLOPE_C,
    START_B,
    START_C,
    WIDTH,
)
from tomo.trace.sources import PixelSource

RAYS_AT_ONCE = 16_384

_ORDERS = ((0, 1, 2), (1, 0, 2), (2, 0, 1))  # the axes a, b, c while looking, for each a


@dataclass(frozen=True, eq=False)
class Survey:
    """What the rays of some pixels do in a grid.

    Attributes
    ----------
    layers : (3,) int64
        Layers of voxels that the rays pass along x, y and z, each ray along its long axis.
    changes : (3, 3) int64
        How often rays with a long axis (rows) get from one voxel to the next along another.
    meets : (P,) bool
        Whether a ray of the pixel meets the grid.
    """

    layers: NDArray[np.int64]
    changes: NDArray[np.int64]
    meets: NDArray[np.bool_]

    @property
    def axes(self) -> tuple[bool, bool, bool]:
        """Whether any ray has x, y or z for its long axis."""
        return tuple(self.layers > 0)

    @property
    def crossings(self) -> int:
        """Crossings of rays with voxels, edges and corners aside."""
        return int(self.layers.sum() + self.changes.sum())


def survey(source: PixelSource, grid: VoxelGrid) -> Survey:
    """Look at all rays of a source."""
    layers, changes = np.zeros(3, np.int64), np.zeros((3, 3), np.int64)
    meets = np.zeros(source.n_pixels, np.bool_)
    counted: list[tuple[int, NDArray[np.int64]]] = []

    def worker() -> Callable[[tuple[int, int, int]], None]:
        def look(portion: tuple[int, int, int]) -> None:
            start, stop, count = portion
            courses, ptr = np.zeros((count, WIDTH)), source.ray_ptr(start, stop)
            for axes in _ORDERS:
                source.write(start, stop, grid, axes, courses)
                inside = courses[:, LEAVE] > courses[:, ENTER]
                if inside.any():
                    counted.append((axes[0], _steps(courses[inside], grid, axes)))
                    met = np.append(0, np.cumsum(inside))
                    meets[start:stop] |= np.diff(met[ptr]) > 0

        return look

    share_out(source.portions(RAYS_AT_ONCE), numba.get_num_threads(), worker)
    for axis, steps in counted:
        layers[axis] += steps[0]
        changes[axis, list(_ORDERS[axis][1:])] += steps[1:]
    return Survey(layers, changes, meets)


def _steps(
    courses: NDArray[np.float64], grid: VoxelGrid, axes: tuple[int, int, int]
) -> NDArray[np.int64]:
    """Count the layers that rays pass along a, and their changes along b and c, ``(3,)``."""
    enter, leave = courses[:, ENTER], courses[:, LEAVE]
    steps = [int((np.ceil(leave) - np.floor(enter)).sum())]
    for axis, start, slope in zip(axes[1:], (START_B, START_C), (SLOPE_B, SLOPE_C), strict=True):
        first, last = (
            np.clip(np.floor(t * np.abs(courses[:, slope]) + courses[:, start]), 0, most)
            for t, most in ((enter, grid.shape[axis] - 1), (leave, grid.shape[axis] - 1))
        )
        steps.append(int((last - first).sum()))
    return np.array(steps)
