"""Chunks of work: pixels whose rays one thread projects at a time, from one source or several."""

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
from tomo.operators.on_the_fly.ray_setup import WIDTH
from tomo.operators.on_the_fly.ray_sources import PixelSource, Write
from tomo.operators.on_the_fly.running_sums import Axes

RAYS_AT_ONCE = 16_384
"""Rays of a chunk, 1 MB of parameters: more leave the cache, fewer cost calls."""

Visit = Callable[["Chunk", NDArray[np.float64], NDArray[np.int64]], None]
"""Uses a chunk, its rays' parameters (N, 8), and where each pixel's rays begin (P + 1,)."""

Group = TypeVar("Group")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some pixels of a projector with their rays.

    Attributes
    ----------
    parts : tuple of (source, start, stop)
        Pixels of sources, one after another.
    spans : tuple of (start, stop)
        Which pixels of the projector those of each part are.
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

    Parameters
    ----------
    sources : sequence of PixelSource
        Their pixels, one source after another, are those of a projector.
    wanted : sequence of bool
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

    Parameters
    ----------
    groups : sequence of (anything, chunks)
        A group's key and its chunks; a chunk may be in several groups.
    grid : VoxelGrid
    axes : (int, int, int)
    visitor : callable
        Called with a group's key; returns the function to call for its chunks.
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
