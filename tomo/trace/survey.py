"""What rays do in a grid, before they are projected: which way, how much, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.trace.columns import ORDERS, Axes
from tomo.trace.courses import ENTER, LEAVE, SLOPE_B, SLOPE_C, START_B, START_C
from tomo.trace.shares import Share, follow_all, shares_of
from tomo.trace.sources import PixelSource


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
    shares = list(shares_of([source], [True]))
    for axes in ORDERS:
        layers[axes[0]], *along = _follow(shares, grid, axes, meets)
        changes[axes[0], list(axes[1:])] = along
    return Survey(layers, changes, meets)


def _follow(
    shares: Sequence[Share], grid: VoxelGrid, axes: Axes, meets: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Count the steps of all rays with one long axis, ``(3,)``, and mark their pixels."""
    counted = [np.zeros(3, np.int64)]

    def look(share: Share, courses: NDArray, pixel_ptr: NDArray) -> None:
        inside = courses[:, LEAVE] > courses[:, ENTER]
        if inside.any():
            counted.append(_steps(courses[inside], grid, axes))
            met = np.append(0, np.cumsum(inside))
            share.add_to(meets, np.diff(met[pixel_ptr]) > 0)

    follow_all(shares, grid, axes, lambda: look)
    return np.sum(counted, axis=0)


def _steps(courses: NDArray[np.float64], grid: VoxelGrid, axes: Axes) -> NDArray[np.int64]:
    """Count the layers that rays pass along a, and their changes along b and c, ``(3,)``."""
    enter, leave = courses[:, ENTER], courses[:, LEAVE]
    steps = [int((np.ceil(leave) - np.floor(enter)).sum())]
    for axis, start, slope in zip(axes[1:], (START_B, START_C), (SLOPE_B, SLOPE_C), strict=True):
        start, slope, last = courses[:, start], np.abs(courses[:, slope]), grid.shape[axis] - 1
        into, out = (np.clip(np.floor(t * slope + start), 0, last) for t in (enter, leave))
        steps.append(int((out - into).sum()))
    return np.array(steps)
