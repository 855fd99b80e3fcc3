"""The active voxels as lines along z: room for what lies between and beside them, and no more."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

Lines = tuple[NDArray[np.integer], ...]
"""Lines along z: where each begins in what holds all of them (lines + 1,), at which height along z
it begins (lines,), its place (lines, 2), and the number of the line at each place, -1 where there
is none (nx, ny)."""


@compiled(inline=True)
def add(onto, begin, end, height, weight, added, first, last, at) -> None:
    """Add ``weight`` times ``added[first:last]`` to ``onto[begin:end]`` where there is both.

    ``height`` and ``at`` are where along z the two begin.
    """
    low = max(height, at)
    count = min(height + end - begin, at + last - first) - low
    if count > 0:
        here, there = np.uint64(begin + low - height), np.uint64(first + low - at)
        for z in range(np.uint64(count)):
            onto[here + z] += weight * added[there + z]


@compiled(inline=True)
def lay_out(values, voxels, heights, own, number, lines) -> None:
    """Write the voxels of a line to where it is in ``lines``, with zeros between them."""
    first, low = own[0][number], own[1][number]
    lines[first : own[0][number + 1]] = 0
    for voxel in range(voxels[number], voxels[number + 1]):
        lines[np.uint64(first + heights[voxel] - low)] = values[voxel]


@compiled(inline=True)
def pick_up(lines, voxels, heights, own, number, values) -> None:
    """Write to the voxels of a line what stands where they are in ``lines``; undoes `lay_out`."""
    first, low = own[0][number], own[1][number]
    for voxel in range(voxels[number], voxels[number + 1]):
        values[voxel] = lines[np.uint64(first + heights[voxel] - low)]


class LiveLines:
    """The lines along z that hold active voxels, from the lowest of each to the highest.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        Where voxels are active.

    Attributes
    ----------
    depth : int
        Of the grid, along z.
    inside : (nx, ny) bool
        Where there is a line.
    low, high : (nx, ny) int
        The lowest active voxel of each column and the one above the highest; ``depth`` and zero
        where there is no line.
    voxels : (lines + 1,) int64
        Where the active voxels of each line begin among all.
    heights : (n,) int32
        Of every active voxel along z.
    own : Lines
        The lines themselves.
    """

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        self.depth = mask.shape[2]
        self.inside = mask.any(axis=2)
        self.low = np.where(self.inside, mask.argmax(axis=2), self.depth)
        last = self.depth - mask[:, :, ::-1].argmax(axis=2)
        self.high = np.where(self.inside, last, 0)
        self.voxels = np.append(0, np.cumsum(np.count_nonzero(mask, axis=2)[self.inside]))
        self.heights = (np.flatnonzero(mask) % self.depth).astype(np.int32)
        self.own = lines_between(self.low, self.high)


def lines_between(low: NDArray[np.integer], high: NDArray[np.integer]) -> Lines:
    """Return the lines from ``low`` to ``high`` (nx, ny), where ``high`` is above ``low``."""
    numbers = np.full(low.shape, -1, np.int64)
    places = np.argwhere(high > low)
    x, y = places.T
    numbers[x, y] = np.arange(len(places))
    begin = np.append(0, np.cumsum(high[x, y] - low[x, y]))
    return begin, low[x, y], places, numbers
