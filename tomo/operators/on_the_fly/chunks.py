"""Chunks of work: pixels whose rays one thread projects at a time; what rays cross and meet."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.threads import run_chunks
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.ray_setup import (
    ENTER,
    LEAVE,
    SLOPE_B,
    SLOPE_C,
    START_B,
    START_C,
    WIDTH,
)
from tomo.operators.on_the_fly.ray_sources import PixelSource, Write
from tomo.operators.on_the_fly.running_sums import ORDERS, Axes

RAYS_AT_ONCE = 16_384
"""Rays that a thread traces or projects at once, 1 MB of parameters: more leave the cache and let
threads end apart, fewer cost calls."""

Visit = Callable[["Chunk", NDArray[np.float64], NDArray[np.int64]], None]
"""Uses a chunk, its rays' parameters (N, 8), and where each pixel's rays begin (P + 1,)."""

Group = TypeVar("Group")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some pixels of a projector with their rays.

    ``parts`` are pixels of sources, one part after another; ``spans`` say which pixels of the
    projector those of each part are.
    """

    parts: tuple[tuple[PixelSource, int, int], ...]
    spans: tuple[tuple[int, int], ...]

    def parameters(
        self, writers: Mapping[PixelSource, Write], room: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the rays' parameters (N, 8), and where each pixel's rays begin (P + 1,).

        ``writers`` write the parameters of each source, into ``room`` where that is large enough.
        """
        ptrs = [source.ray_ptr(start, stop) for source, start, stop in self.parts]
        ends = list(itertools.accumulate((int(ptr[-1]) for ptr in ptrs), initial=0))
        parameters = room[: ends[-1]] if ends[-1] <= len(room) else np.zeros((ends[-1], WIDTH))
        for (source, start, stop), low, high in zip(self.parts, ends[:-1], ends[1:], strict=True):
            writers[source](start, stop, parameters[low:high])
        if len(ptrs) == 1:
            return parameters, ptrs[0]
        rest = [ptr[1:] + low for ptr, low in zip(ptrs, ends[:-1], strict=True)]
        return parameters, np.concatenate([np.zeros(1, np.int64), *rest])

    def of(self, images: NDArray) -> NDArray[np.float64]:
        """Return these pixels of images (pixels,)."""
        return np.concatenate([images[start:stop] for start, stop in self.spans], dtype=np.float64)

    def add_to(self, images: NDArray, some: NDArray) -> None:
        """Add ``some``, one value for each of these pixels, to images (pixels,)."""
        at, some = 0, some.astype(images.dtype)
        for start, stop in self.spans:
            images[start:stop] += some[at : at + stop - start]
            at += stop - start


def chunks_of(sources: Sequence[PixelSource], wanted: Sequence[bool]) -> Iterator[Chunk]:
    """Iterate over the pixels of the wanted sources, at most `RAYS_AT_ONCE` rays at a time.

    The pixels of ``sources``, one source after another, are those of a projector.
    """
    parts: list[tuple[PixelSource, int, int]] = []
    spans: list[tuple[int, int]] = []
    rays, first = 0, 0
    for source, want in zip(sources, wanted, strict=True):
        for start, stop, count in source.portions(RAYS_AT_ONCE) if want else ():
            if rays + count > RAYS_AT_ONCE and parts:
                yield Chunk(tuple(parts), tuple(spans))
                parts, spans, rays = [], [], 0
            parts.append((source, start, stop))
            spans.append((first + start, first + stop))
            rays += count
        first += source.n_pixels
    if parts:
        yield Chunk(tuple(parts), tuple(spans))


def project_chunks(chunks: Sequence[Chunk], grid: VoxelGrid, axes: Axes, visit: Visit) -> None:
    """Call ``visit`` for each chunk with its rays of driving axis ``axes[0]``, on all threads."""
    project_groups([(None, (chunk,)) for chunk in chunks], grid, axes, lambda _: visit)


def project_groups(
    groups: Sequence[tuple[Group, Sequence[Chunk]]],
    grid: VoxelGrid,
    axes: Axes,
    visitor: Callable[[Group], Visit],
) -> None:
    """Call visitors for groups of chunks, on all threads; one group stays on one thread.

    A group has a key and chunks, which other groups may have too. ``visitor`` is called with a
    group's key and returns the function to call for its chunks.
    """
    sources = {source for _, chunks in groups for chunk in chunks for source, _, _ in chunk.parts}
    writers = {source: source.writer(grid, axes) for source in sources}

    def worker() -> Callable[[tuple[Group, Sequence[Chunk]]], None]:
        room = np.zeros((RAYS_AT_ONCE, WIDTH))  # new memory costs more than writing to it

        def do(group: tuple[Group, Sequence[Chunk]]) -> None:
            visit = visitor(group[0])
            for chunk in group[1]:
                visit(chunk, *chunk.parameters(writers, room))

        return do

    run_chunks(groups, numba.get_num_threads(), worker)


@dataclass(frozen=True, eq=False)
class CrossingCounts:
    """How many voxels the rays of some pixels cross.

    ``slabs`` (3,) are those that rays with driving axis x, y and z pass along it, ``faces``
    (3, 3) their face crossings along each axis (columns). ``meets`` (P,) says whether a ray of
    the pixel meets the grid.
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

    ``spans`` (chunks, 2) are the first column that a chunk's rays meet and the one after the
    last; zeros where none do. ``rays`` (n_b,) counts the rays that meet each column.
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

        Of one column along b at least.
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
