"""What rays do in a grid, before they are projected: which way, how much, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.trace.columns import across
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

RAYS_AT_ONCE = 32_768
SAMPLED = 1024  # rays of a block from which the threads' shares are estimated

_ACROSS = ((START_B, SLOPE_B), (START_C, SLOPE_C))


@dataclass(frozen=True, eq=False)
class Survey:
    """What the rays of some pixels do in a grid.

    Attributes
    ----------
    axes : (bool, bool, bool)
        Whether any ray has x, y or z for its long axis.
    crossings : int
        Crossings of rays with voxels, edges and corners aside.
    meets : (P,) bool
        Whether a ray of the pixel meets the grid.
    """

    axes: tuple[bool, bool, bool]
    crossings: int
    meets: NDArray[np.bool_]


def survey(source: PixelSource, grid: VoxelGrid) -> Survey:
    """Look at all rays of a source."""
    axes, crossings = [False] * 3, 0
    meets = np.zeros(source.n_pixels, np.bool_)
    for start, stop, count in source.portions(RAYS_AT_ONCE):
        courses = np.zeros((count, WIDTH))
        ptr = source.ray_ptr(start, stop)
        for axis in range(3):
            source.write(start, stop, grid, axis, courses)
            inside = courses[:, LEAVE] > courses[:, ENTER]
            if not inside.any():
                continue
            axes[axis] = True
            crossings += _crossings(courses[inside], grid, axis)
            met = np.append(0, np.cumsum(inside))
            meets[start:stop] |= np.diff(met[ptr]) > 0
    return Survey(tuple(axes), crossings, meets)


def _crossings(courses: NDArray[np.float64], grid: VoxelGrid, axis: int) -> int:
    """Count the voxels that rays meet."""
    layers = np.ceil(courses[:, LEAVE]) - np.floor(courses[:, ENTER])
    total = int(layers.sum())
    for side, (start, slope) in zip(across(axis), _ACROSS, strict=True):
        first, last = _voxels(courses, start, slope, grid.shape[side])
        total += int((last - first).sum())
    return total


def _voxels(
    courses: NDArray[np.float64], start: int, slope: int, count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and the last voxel along an axis, counted as the courses count them."""
    ends = courses[:, [ENTER, LEAVE]] * np.abs(courses[:, slope, None]) + courses[:, start, None]
    return tuple(np.clip(np.floor(ends.T), 0, count - 1).astype(np.int64))


def cuts_of_equal_work(
    courses: NDArray[np.float64], count: int, low: int, high: int, parts: int
) -> NDArray[np.int64]:
    """Cut the columns from ``low`` to ``high`` along b into ranges with equal shares of the rays.

    Parameters
    ----------
    courses : (N, 8) float64
        Courses of rays with one long axis.
    count : int
        Voxels along b.
    low, high, parts : int

    Returns
    -------
    (parts + 1,) int64
        From ``low`` to ``high``.
    """
    if parts == 1:
        return np.array([low, high])
    some = courses[:: max(len(courses) // SAMPLED, 1)]
    some = some[some[:, LEAVE] > some[:, ENTER]]
    one, other = _voxels(some, START_B, SLOPE_B, count)
    mirrored = some[:, SLOPE_B] < 0
    first = np.where(mirrored, count - 1 - other, one)
    last = np.where(mirrored, count - 1 - one, other)
    density = (some[:, LEAVE] - some[:, ENTER]) / (last - first + 1)
    steps = np.bincount(first, density, count + 1) - np.bincount(last + 1, density, count + 1)
    work = np.append(0.0, np.cumsum(np.cumsum(steps)[:-1]))[low : high + 1]  # below each voxel
    wanted = work[0] + (work[-1] - work[0]) * np.arange(1, parts) / parts
    inner = np.maximum.accumulate(np.searchsorted(work, wanted)) + low
    return np.concatenate([[low], np.clip(inner, low, high), [high]]).astype(np.int64)
