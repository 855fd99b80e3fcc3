"""The pass before any product: count what rays cross, and find which columns they meet."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.chunks import Chunk, chunks_of, project_chunks
from tomo.operators.on_the_fly.ray_setup import ENTER, LEAVE, SLOPE_B, SLOPE_C, START_B, START_C
from tomo.operators.on_the_fly.ray_sources import PixelSource
from tomo.operators.on_the_fly.running_sums import ORDERS, Axes


@dataclass(frozen=True, eq=False)
class CrossingCounts:
    """How many voxels the rays of some pixels cross.

    Attributes
    ----------
    slabs : (3,) int64
        Slabs that rays with driving axis x, y and z pass along it.
    faces : (3, 3) int64
        Face crossings of rays with a driving axis (rows) along each other axis (columns).
    meets : (P,) bool
        Whether a ray of the pixel meets the grid.
    """

    slabs: NDArray[np.int64]
    faces: NDArray[np.int64]
    meets: NDArray[np.bool_]

    @property
    def axes(self) -> tuple[bool, bool, bool]:
        """Whether any ray has x, y or z for its driving axis."""
        return tuple(self.slabs > 0)

    @property
    def segments(self) -> int:
        """Segments of rays in voxels; passing an edge counts as two face crossings."""
        return int(self.slabs.sum() + self.faces.sum())


def count_crossings(source: PixelSource, grid: VoxelGrid) -> CrossingCounts:
    """Count what all rays of a source cross."""
    slabs, faces = np.zeros(3, np.int64), np.zeros((3, 3), np.int64)
    meets = np.zeros(source.n_pixels, np.bool_)
    chunks = list(chunks_of([source], [True]))
    for axes in ORDERS:
        slabs[axes[0]], *along = _count(chunks, grid, axes, meets)
        faces[axes[0], list(axes[1:])] = along
    return CrossingCounts(slabs, faces, meets)


MARGIN = 1e-6
"""Voxels by which a ray's columns are widened: the adjoint must not miss one by rounding."""


@dataclass(frozen=True, eq=False)
class ColumnsMet:
    """The columns along b that rays with one driving axis meet.

    Attributes
    ----------
    spans : (chunks, 2) int64
        First column that a chunk's rays meet and the one after the last; zeros where none do.
    rays : (n_b,) int64
        Rays that meet each column.
    """

    spans: NDArray[np.int64]
    rays: NDArray[np.int64]

    def groups(
        self, chunks: Sequence[Chunk], columns: range, count: int
    ) -> list[tuple[tuple[int, int], list[Chunk]]]:
        """Return the `even_ranges`, each with the chunks whose rays meet it."""
        first, end = self.spans.T
        found = []
        for low, high in self.even_ranges(columns, count):
            met = np.flatnonzero((first < high) & (end > low)).tolist()
            found.append(((low, high), [chunks[number] for number in met]))
        return found

    def even_ranges(self, columns: range, count: int) -> list[tuple[int, int]]:
        """Split ``columns`` into at most ``count`` ranges of about equal work.

        Parameters
        ----------
        columns : range
            Along b, one at least.
        count : int
        """
        low, high = columns[0], columns[-1] + 1
        done = np.cumsum(self.rays[low:high] + 1)  # one more: columns no ray meets take work, too
        wanted = done[-1] * np.arange(1, count) / count
        cuts = np.searchsorted(done, wanted) + 1  # behind the column that reaches it
        ends = np.unique([low, *np.minimum(low + cuts, high), high])
        return list(itertools.pairwise(ends.tolist()))


def columns_met(chunks: Sequence[Chunk], grid: VoxelGrid, axes: Axes) -> ColumnsMet:
    """Return the columns that the chunks' rays with driving axis ``axes[0]`` meet."""
    n_b = grid.shape[axes[1]]
    spans, none = dict.fromkeys(chunks, (0, 0)), np.zeros(n_b, np.int64)
    counts: list[NDArray[np.int64]] = []

    def visit(chunk: Chunk, parameters: NDArray, pixel_ptr: NDArray) -> None:
        inside = parameters[parameters[:, LEAVE] > parameters[:, ENTER]]
        if len(inside):
            into, out = _ends(inside, START_B, SLOPE_B)
            mirrored = inside[:, SLOPE_B] < 0
            low, high = np.where(mirrored, n_b - out, into), np.where(mirrored, n_b - into, out)
            first = np.clip(np.floor(low - MARGIN), 0, n_b - 1).astype(np.int64)
            last = np.clip(np.floor(high + MARGIN), 0, n_b - 1).astype(np.int64)
            spans[chunk] = int(first.min()), int(last.max()) + 1
            entered, left = (np.bincount(some, minlength=n_b) for some in (first, last))
            counts.append(np.cumsum(entered) - np.cumsum(left) + left)

    project_chunks(chunks, grid, axes, visit)
    return ColumnsMet(np.array(list(spans.values()), np.int64).reshape(-1, 2), sum(counts, none))


def _count(
    chunks: Sequence[Chunk], grid: VoxelGrid, axes: Axes, meets: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Count what all rays with one driving axis cross, ``(3,)``, and mark their pixels."""
    counted = [np.zeros(3, np.int64)]

    def visit(chunk: Chunk, parameters: NDArray, pixel_ptr: NDArray) -> None:
        inside = parameters[:, LEAVE] > parameters[:, ENTER]
        if inside.any():
            counted.append(_steps(parameters[inside], grid, axes))
            met = np.append(0, np.cumsum(inside))
            chunk.add_to(meets, np.diff(met[pixel_ptr]) > 0)

    project_chunks(chunks, grid, axes, visit)
    return np.sum(counted, axis=0)


def _steps(parameters: NDArray[np.float64], grid: VoxelGrid, axes: Axes) -> NDArray[np.int64]:
    """Count the slabs that rays pass along a, and the faces along b and c, ``(3,)``."""
    enter, leave = parameters[:, ENTER], parameters[:, LEAVE]
    steps = [int((np.ceil(leave) - np.floor(enter)).sum())]
    for axis, start, slope in zip(axes[1:], (START_B, START_C), (SLOPE_B, SLOPE_C), strict=True):
        ends = _ends(parameters, start, slope)
        into, out = (np.clip(np.floor(end), 0, grid.shape[axis] - 1) for end in ends)
        steps.append(int((out - into).sum()))
    return np.array(steps)


def _ends(
    parameters: NDArray[np.float64], start: int, slope: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the positions along b or c where rays enter and leave, mirrored as in `ray_setup`."""
    enter, leave = (
        parameters[:, t] * np.abs(parameters[:, slope]) + parameters[:, start]
        for t in (ENTER, LEAVE)
    )
    return enter, leave
