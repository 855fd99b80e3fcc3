"""Shares of pixels whose rays one thread follows at a time, whichever sources they come from."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.threads import share_out
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.ray_setup import WIDTH
from tomo.operators.on_the_fly.ray_sources import PixelSource, Write
from tomo.operators.on_the_fly.running_sums import Axes

RAYS_AT_ONCE = 16_384  # 1 MB of courses, which stays near the core that makes them

Follow = Callable[["Share", NDArray[np.float64], NDArray[np.int64]], None]
"""Does something with a share, its courses (N, 8), and where each pixel's begin (P + 1,)."""

Group = TypeVar("Group")


@dataclass(frozen=True, eq=False)
class Share:
    """Some pixels of a projector with their rays.

    Attributes
    ----------
    pieces : tuple of (source, start, stop)
        Pixels of sources, one after another.
    spans : tuple of (start, stop)
        Which pixels of the projector those of each piece are.
    """

    pieces: tuple[tuple[PixelSource, int, int], ...]
    spans: tuple[tuple[int, int], ...]

    def courses(
        self, writers: Mapping[PixelSource, Write], room: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the courses of all rays, and where each pixel's begin; in ``room`` if it will do.

        ``(N, 8)`` and ``(P + 1,)``; ``writers`` write the courses of each source.
        """
        ptrs = [source.ray_ptr(start, stop) for source, start, stop in self.pieces]
        ends = list(itertools.accumulate((int(ptr[-1]) for ptr in ptrs), initial=0))
        courses = room[: ends[-1]] if ends[-1] <= len(room) else np.zeros((ends[-1], WIDTH))
        for (source, start, stop), low, high in zip(self.pieces, ends[:-1], ends[1:], strict=True):
            writers[source](start, stop, courses[low:high])
        if len(ptrs) == 1:
            return courses, ptrs[0]
        rest = [ptr[1:] + low for ptr, low in zip(ptrs, ends[:-1], strict=True)]
        return courses, np.concatenate([np.zeros(1, np.int64), *rest])

    def of(self, images: NDArray) -> NDArray[np.float64]:
        """Return these pixels of images (pixels,)."""
        return np.concatenate([images[start:stop] for start, stop in self.spans], dtype=np.float64)

    def add_to(self, images: NDArray, some: NDArray) -> None:
        """Add ``some``, one value for each of these pixels, to images (pixels,)."""
        at, some = 0, some.astype(images.dtype)
        for start, stop in self.spans:
            images[start:stop] += some[at : at + stop - start]
            at += stop - start


def shares_of(sources: Sequence[PixelSource], wanted: Sequence[bool]) -> Iterator[Share]:
    """Go through the pixels of those sources that are wanted, some rays at a time.

    Parameters
    ----------
    sources : sequence of PixelSource
        Whose pixels, one source's after another's, are those of a projector.
    wanted : sequence of bool
    """
    pieces, spans, rays, first = [], [], 0, 0
    for source, want in zip(sources, wanted, strict=True):
        for start, stop, count in source.portions(RAYS_AT_ONCE) if want else ():
            if rays + count > RAYS_AT_ONCE and pieces:
                yield Share(tuple(pieces), tuple(spans))
                pieces, spans, rays = [], [], 0
            pieces.append((source, start, stop))
            spans.append((first + start, first + stop))
            rays += count
        first += source.n_pixels
    if pieces:
        yield Share(tuple(pieces), tuple(spans))


def follow_all(shares: Sequence[Share], grid: VoxelGrid, axes: Axes, follow: Follow) -> None:
    """Follow the rays of all shares that have ``axes[0]`` for long axis, on all threads."""
    follow_groups([(None, (share,)) for share in shares], grid, axes, lambda _: follow)


def follow_groups(
    groups: Sequence[tuple[Group, Sequence[Share]]],
    grid: VoxelGrid,
    axes: Axes,
    follow_in: Callable[[Group], Follow],
) -> None:
    """Follow the rays of groups of shares, on all threads, those of a group on one.

    Parameters
    ----------
    groups : sequence of (anything, shares)
        What a group is known by, and its shares; one may be in several groups.
    grid : VoxelGrid
    axes : (int, int, int)
    follow_in : callable
        Called with what a group is known by; returns what follows the rays of its shares.
    """
    sources = {source for _, shares in groups for share in shares for source, _, _ in share.pieces}
    writers = {source: source.writer(grid, axes) for source in sources}

    def worker() -> Callable[[tuple[Group, Sequence[Share]]], None]:
        room = np.zeros((RAYS_AT_ONCE, WIDTH))  # new memory costs more than what is written to it

        def do(group: tuple[Group, Sequence[Share]]) -> None:
            follow = follow_in(group[0])
            for share in group[1]:
                follow(share, *share.courses(writers, room))

        return do

    share_out(groups, numba.get_num_threads(), worker)
