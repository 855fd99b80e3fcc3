"""What rays do in a grid, before they are projected: which way, how much, and where."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.chunks import Share, follow_all, shares_of
from tomo.operators.on_the_fly.ray_setup import ENTER, LEAVE, SLOPE_B, SLOPE_C, START_B, START_C
from tomo.operators.on_the_fly.ray_sources import PixelSource
from tomo.operators.on_the_fly.running_sums import ORDERS, Axes


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


MARGIN = 1e-6
"""Voxels by which columns are told generously, for the last bits of where a ray is."""


@dataclass(frozen=True, eq=False)
class ColumnsMet:
    """Which columns along b rays with one long axis meet.

    Attributes
    ----------
    spans : (shares, 2) int64
        The first that rays of a share meet and the one after the last; both zero where none do.
    rays : (n_b,) int64
        How many rays meet each.
    """

    spans: NDArray[np.int64]
    rays: NDArray[np.int64]

    def groups(
        self, shares: Sequence[Share], columns: range, count: int
    ) -> list[tuple[tuple[int, int], list[Share]]]:
        """Return the `even_ranges`, each with those of the shares whose rays meet it."""
        first, end = self.spans.T
        return [
            ((low, high), [shares[n] for n in np.flatnonzero((first < high) & (end > low))])
            for low, high in self.even_ranges(columns, count)
        ]

    def even_ranges(self, columns: range, count: int) -> list[tuple[int, int]]:
        """Return at most ``count`` ranges that make up ``columns``, of about the same work each.

        Parameters
        ----------
        columns : range
            Along b, one at least.
        count : int
        """
        low, high = columns[0], columns[-1] + 1
        done = np.cumsum(self.rays[low:high] + 1)  # one more: those that no ray meets are cut, too
        wanted = done[-1] * np.arange(1, count) / count
        cuts = np.searchsorted(done, wanted) + 1  # behind the column where so much is done
        ends = np.unique([low, *np.minimum(low + cuts, high), high])
        return list(itertools.pairwise(ends.tolist()))


def columns_met(shares: Sequence[Share], grid: VoxelGrid, axes: Axes) -> ColumnsMet:
    """Look at all rays of shares that have ``axes[0]`` for long axis."""
    n_b = grid.shape[axes[1]]
    spans, counts = dict.fromkeys(shares, (0, 0)), [np.zeros(n_b, np.int64)]

    def look(share: Share, courses: NDArray, pixel_ptr: NDArray) -> None:
        inside = courses[courses[:, LEAVE] > courses[:, ENTER]]
        if len(inside):
            into, out = _ends(inside, START_B, SLOPE_B)
            mirrored = inside[:, SLOPE_B] < 0
            low, high = np.where(mirrored, n_b - out, into), np.where(mirrored, n_b - into, out)
            first = np.clip(np.floor(low - MARGIN), 0, n_b - 1).astype(np.int64)
            last = np.clip(np.floor(high + MARGIN), 0, n_b - 1).astype(np.int64)
            spans[share] = int(first.min()), int(last.max()) + 1
            entered, left = (np.bincount(some, minlength=n_b) for some in (first, last))
            counts.append(np.cumsum(entered) - np.cumsum(left) + left)

    follow_all(shares, grid, axes, look)
    return ColumnsMet(np.array(list(spans.values()), np.int64).reshape(-1, 2), sum(counts))


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

    follow_all(shares, grid, axes, look)
    return np.sum(counted, axis=0)


def _steps(courses: NDArray[np.float64], grid: VoxelGrid, axes: Axes) -> NDArray[np.int64]:
    """Count the layers that rays pass along a, and their changes along b and c, ``(3,)``."""
    enter, leave = courses[:, ENTER], courses[:, LEAVE]
    steps = [int((np.ceil(leave) - np.floor(enter)).sum())]
    for axis, start, slope in zip(axes[1:], (START_B, START_C), (SLOPE_B, SLOPE_C), strict=True):
        ends = _ends(courses, start, slope)
        into, out = (np.clip(np.floor(end), 0, grid.shape[axis] - 1) for end in ends)
        steps.append(int((out - into).sum()))
    return np.array(steps)


def _ends(
    courses: NDArray[np.float64], start: int, slope: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where along b or c rays enter the grid and leave it, as their courses count it."""
    enter, leave = (
        courses[:, t] * np.abs(courses[:, slope]) + courses[:, start] for t in (ENTER, LEAVE)
    )
    return enter, leave
