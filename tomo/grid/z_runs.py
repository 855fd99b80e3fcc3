"""The active voxels as runs along z, from the lowest to the highest of each column."""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

Runs = tuple[NDArray[np.integer], ...]
"""Runs along z: the start of each in one array (runs + 1,), its lowest index along z (runs,),
its column (runs, 2), and the number of the run in each column, -1 if there is none (nx, ny)."""


@compiled(inline=True)
def add(onto, begin, end, height, weight, added, first, last, at) -> None:
    """Add ``weight`` times ``added[first:last]`` to ``onto[begin:end]`` where there is both.

    ``height`` and ``at`` are the indices along z at which the two begin.
    """
    low = max(height, at)
    count = min(height + end - begin, at + last - first) - low
    if count > 0:
        here, there = np.uint64(begin + low - height), np.uint64(first + low - at)
        for z in range(np.uint64(count)):
            onto[here + z] += weight * added[there + z]


@compiled(inline=True)
def lay_out(values, voxels, heights, own, number, runs) -> None:
    """Write the voxels of a run to its part of ``runs``, with zeros between them."""
    first, low = own[0][number], own[1][number]
    runs[first : own[0][number + 1]] = 0
    for voxel in range(voxels[number], voxels[number + 1]):
        runs[np.uint64(first + heights[voxel] - low)] = values[voxel]


@compiled(inline=True)
def pick_up(runs, voxels, heights, own, number, values) -> None:
    """Write the voxels of a run from its part of ``runs``: undoes `lay_out`."""
    first, low = own[0][number], own[1][number]
    for voxel in range(voxels[number], voxels[number + 1]):
        values[voxel] = runs[np.uint64(first + heights[voxel] - low)]


class ZRuns:
    """The runs along z that hold active voxels, from the lowest of each column to the highest.

    ``low`` and ``high`` (nx, ny) are a column's lowest active voxel and the one above the highest,
    the ``depth`` and zero where none is ``inside``. ``voxels`` (runs + 1,) are the first active
    voxel of each run, ``heights`` (n,) every active voxel's index along z, ``own`` the `Runs`.
    """

    def __init__(self, mask: NDArray[np.bool_]) -> None:
        self.depth = mask.shape[2]
        self.inside = mask.any(axis=2)
        self.low = np.where(self.inside, mask.argmax(axis=2), self.depth)
        last = self.depth - mask[:, :, ::-1].argmax(axis=2)
        self.high = np.where(self.inside, last, 0)
        self.voxels = np.append(0, np.cumsum(np.count_nonzero(mask, axis=2)[self.inside]))
        self.heights = (np.flatnonzero(mask) % self.depth).astype(np.int32)
        self.own = runs_between(self.low, self.high)

    def side_by_side(self, columns: int) -> ZRuns:
        """Return the runs of ``columns`` volumes whose values at a voxel lie side by side.

        Such volumes, ``(n, columns)``, are one with ``columns`` times as many voxels along z.
        """
        if columns == 1:
            return self
        wide = copy.copy(self)
        wide.depth, wide.low, wide.high = (columns * n for n in (self.depth, self.low, self.high))
        wide.voxels = columns * self.voxels
        layers = np.arange(columns, dtype=np.int32)
        wide.heights = (columns * self.heights[:, None] + layers).ravel()
        wide.own = runs_between(wide.low, wide.high)
        return wide


def runs_between(low: NDArray[np.integer], high: NDArray[np.integer]) -> Runs:
    """Return the runs from ``low`` to ``high`` (nx, ny), where ``high`` is above ``low``."""
    numbers = np.full(low.shape, -1, np.int64)
    columns = np.argwhere(high > low)
    x, y = columns.T
    numbers[x, y] = np.arange(len(columns))
    begin = np.append(0, np.cumsum(high[x, y] - low[x, y]))
    return begin, low[x, y], columns, numbers
