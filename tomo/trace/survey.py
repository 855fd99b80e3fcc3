"""What rays do in a grid, before they are projected: which way, how much, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.trace.columns import across
from tomo.trace.layers import (
    COUNT,
    ENTER,
    LEAVE,
    MIRROR_B,
    MIRROR_C,
    SLOPE_B,
    SLOPE_C,
    START_B,
    START_C,
    fixed_point,
)
from tomo.trace.sources import PixelSource

RAYS_AT_ONCE = 32_768
SAMPLED = 4096  # rays of a block from which the threads' shares are estimated

_ACROSS = ((START_B, SLOPE_B, MIRROR_B), (START_C, SLOPE_C, MIRROR_C))


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
    _, bits = fixed_point(grid.shape, np.float64)
    axes, crossings = [False] * 3, 0
    meets = np.zeros(source.n_pixels, np.bool_)
    for start, stop, count in source.portions(RAYS_AT_ONCE):
        whole, real = np.zeros((count, 8), np.int64), np.zeros((count, 5))
        ptr = source.ray_ptr(start, stop)
        for axis in range(3):
            source.write(start, stop, grid, axis, bits, whole, real)
            inside = whole[:, COUNT] > 0
            if not inside.any():
                continue
            axes[axis] = True
            crossings += _crossings(whole[inside], real[inside], bits, grid, axis)
            met = np.append(0, np.cumsum(inside))
            meets[start:stop] |= np.diff(met[ptr]) > 0
    return Survey(tuple(axes), crossings, meets)


def _crossings(whole, real, bits, grid, axis) -> int:
    """Count the voxels that rays meet."""
    total = int(whole[:, COUNT].sum())
    for side, (start, slope, _) in zip(across(axis), _ACROSS, strict=True):
        ends = real[:, [ENTER, LEAVE]] * whole[:, slope, None] + whole[:, start, None]
        voxels = np.clip(np.floor(ends / 2.0**bits), 0, grid.shape[side] - 1)
        total += int((voxels[:, 1] - voxels[:, 0]).sum())
    return total


def cuts_of_equal_work(
    whole: NDArray[np.int64], bits: int, shape: tuple[int, int, int], parts: int
) -> tuple[int, NDArray[np.int64]]:
    """Cut the columns of a grid into ranges with equal shares of the rays' lengths.

    Parameters
    ----------
    whole : (N, 8) int64
        Courses of rays with one long axis.
    bits : int
    shape : (int, int, int)
        Voxels along the axes a, b and c.
    parts : int

    Returns
    -------
    own : int
        The axis that is cut, 1 for b and 2 for c: that which gives the more equal shares.
    cuts : (parts + 1,) int64
    """
    some = whole[:: max(len(whole) // SAMPLED, 1)]
    some = some[some[:, COUNT] > 0]
    best = None
    for own in (1, 2):
        start, slope, mirror = _ACROSS[own - 1]
        last = shape[own] - 1
        one = np.clip(some[:, start] >> bits, 0, last)
        other = np.clip((some[:, start] + some[:, COUNT] * some[:, slope]) >> bits, 0, last)
        low = np.where(some[:, mirror] > 0, last - other, one)
        high = np.where(some[:, mirror] > 0, last - one, other)
        density = some[:, COUNT] / (high - low + 1)
        steps = np.bincount(low, density, last + 2) - np.bincount(high + 1, density, last + 2)
        work = np.append(0.0, np.cumsum(np.cumsum(steps)[:-1]))  # below each layer
        wanted = work[-1] * np.arange(1, parts) / parts
        inner = np.searchsorted(work, wanted)
        inner -= np.abs(work[inner - 1] - wanted) < np.abs(work[inner] - wanted)
        cuts = np.concatenate([[0], np.maximum.accumulate(inner), [last + 1]]).astype(np.int64)
        largest = np.diff(work[cuts]).max()
        visits = (high - low).sum()
        if best is None or (largest, visits) < best[0]:
            best = (largest, visits), own, cuts
    return best[1], best[2]
