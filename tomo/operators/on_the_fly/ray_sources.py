"""Ray sources: pixels with rays, stored here or made when needed (`camera_sources`).

A source writes the parameters of its rays in a grid (`ray_setup`), some pixels at a time. Taking
some of its pixels copies their numbers only, as runs of consecutive ones: one run for each row of
an image takes little memory.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import index_type, take_groups
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.ray_setup import of_rays
from tomo.operators.on_the_fly.running_sums import Axes, in_order
from tomo.rays import Rays


@dataclass(frozen=True, eq=False)
class PixelRuns:
    """Pixel numbers in any order, stored as runs that ascend by one.

    ``first`` (R,) are the numbers with which the runs begin; ``ptr`` (R + 1,) says how many
    numbers stand before each run, and in all.
    """

    first: NDArray[np.integer]
    ptr: NDArray[np.integer]

    @classmethod
    def all_of(cls, count: int) -> PixelRuns:
        """Return the numbers from 0 to ``count - 1``."""
        kind = index_type(count)
        return cls(np.zeros(1, kind), np.array([0, count], kind))

    @classmethod
    def of(cls, numbers: NDArray[np.integer], count: int) -> PixelRuns:
        """Return some ``numbers`` (P,), each below ``count``."""
        cuts = np.flatnonzero(np.diff(numbers) != 1) + 1
        begin = np.concatenate([np.zeros(min(len(numbers), 1), np.int64), cuts])
        kind = index_type(max(count, len(numbers)))
        return cls(numbers[begin].astype(kind), np.append(begin, len(numbers)).astype(kind))

    def __len__(self) -> int:
        """Return the number of pixels."""
        return int(self.ptr[-1])

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<PixelRuns: {len(self)} pixels in {len(self.first)} runs>"

    def run_of(self, number: int) -> int:
        """Return the run in which the pixel at ``number`` is."""
        return int(np.searchsorted(self.ptr, number, side="right")) - 1

    def between(self, start: int, stop: int) -> NDArray[np.integer]:
        """Return the numbers at ``start:stop``: (stop - start,)."""
        low, high = np.searchsorted(self.ptr[1:-1], [start, stop - 1], side="right")
        some = slice(int(low), int(high) + 1)
        ends = np.clip(self.ptr[low : high + 2], start, stop)
        shift = np.repeat(self.first[some] - self.ptr[some], np.diff(ends))
        return np.arange(start, stop, dtype=self.first.dtype) + shift


def pixels_between(ptr: NDArray[np.int64], start: int, stop: int) -> list[tuple[int, slice]]:
    """Return the sources of pixels ``start:stop``, and the slice of each source's own pixels.

    Pixels are numbered one source after another; ``ptr`` (sources + 1,) says where each begins.
    """
    first, last = np.searchsorted(ptr, [start, stop], side="right") - 1
    found = []
    for number in range(first, min(last, len(ptr) - 2) + 1):
        low, high = ptr[number : number + 2].tolist()
        if max(start, low) < min(stop, high):
            found.append((number, slice(max(start, low) - low, min(stop, high) - low)))
    return found


def pixels_by_source(
    ptr: NDArray[np.int64], pixels: NDArray[np.integer]
) -> list[tuple[int, NDArray[np.integer]]]:
    """Return, for each run of ``pixels`` in one source, the source and its own pixel numbers.

    In the order of ``pixels``; a source with several runs comes several times.
    """
    if not len(pixels):
        return []
    source = np.searchsorted(ptr, pixels, side="right") - 1
    cuts = np.flatnonzero(np.diff(source)) + 1
    runs = zip(source[np.append(0, cuts)].tolist(), np.split(pixels, cuts), strict=True)
    return [(number, some - ptr[number]) for number, some in runs]


Numbers = slice | NDArray[np.integer]

Write = Callable[[int, int, NDArray[np.float64]], None]
"""Called as ``write(start, stop, parameters)``: writes those of the pixels' rays (rays, 8)."""


def corners_and_spacing(grid: VoxelGrid) -> NDArray[np.float64]:
    """Return a grid's lower corner, upper corner and spacing, ``(3, 3)``."""
    return np.stack([grid.lower, grid.upper, np.asarray(grid.spacing)])


class PixelSource(ABC):
    """Pixels of one view with their rays."""

    @property
    @abstractmethod
    def n_pixels(self) -> int:
        """Number of pixels."""

    @abstractmethod
    def take(self, numbers: Numbers) -> PixelSource:
        """Return the source of some of the pixels."""

    @property
    @abstractmethod
    def largest_weight(self) -> float:
        """An upper bound of the sum of a pixel's ray weights."""

    @abstractmethod
    def ray_ptr(self, start: int, stop: int) -> NDArray[np.int64]:
        """Return where the rays of each of the pixels ``start:stop`` begin, from zero on."""

    def portions(self, rays: int) -> Iterator[tuple[int, int, int]]:
        """Iterate over the pixels, about ``rays`` rays at a time: ``start, stop, rays``."""
        start = 0
        while start < self.n_pixels:
            stop = self.last_within(start, rays)
            yield start, stop, self.ray_count(start, stop)
            start = stop

    def ray_count(self, start: int, stop: int) -> int:
        """Return how many rays the pixels ``start:stop`` have."""
        return int(self.ray_ptr(start, stop)[-1])

    def last_within(self, start: int, rays: int) -> int:
        """Return where to stop for ``rays`` rays from pixel ``start`` on, one pixel at least."""
        ptr = self.ray_ptr(start, min(start + rays, self.n_pixels))
        return start + max(int(np.searchsorted(ptr, rays, side="right")) - 1, 1)

    @abstractmethod
    def rays(self, start: int, stop: int) -> Rays:
        """Return the rays of the pixels ``start:stop``."""

    @abstractmethod
    def writer(self, grid: VoxelGrid, axes: Axes) -> Write:
        """Return the function that writes the parameters of rays with driving axis ``axes[0]``.

        Every ray has a row; a ray with another driving axis, or one that misses the grid, leaves
        where it enters.
        """


@dataclass(frozen=True, eq=False)
class RayPixels(PixelSource):
    """Pixels of stored rays; ``rows`` are their numbers, None for all."""

    stored: Rays
    rows: NDArray[np.int64] | None = None

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return self.stored.n_pixels if self.rows is None else len(self.rows)

    @property
    def largest_weight(self) -> float:
        """The largest sum of weights; see `PixelSource`."""
        sums = np.diff(
            np.append(0.0, np.cumsum(np.abs(self.stored.weight)))[self.stored.pixel_ptr]
        )
        return float(sums.max(initial=0.0))

    def take(self, numbers: Numbers) -> RayPixels:
        """Return the source of some of the pixels."""
        rows = np.arange(self.stored.n_pixels) if self.rows is None else self.rows
        return RayPixels(self.stored, rows[numbers])

    def ray_ptr(self, start: int, stop: int) -> NDArray[np.int64]:
        """Return where the pixels' rays begin; see `PixelSource`."""
        ptr = self.stored.pixel_ptr
        if self.rows is None:
            return ptr[start : stop + 1] - ptr[start]
        rows = self.rows[start:stop]
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(ptr[rows + 1] - ptr[rows])])

    def rays(self, start: int, stop: int) -> Rays:
        """Return the pixels' rays; see `PixelSource`."""
        numbers = np.arange(start, stop)
        return self.stored.take(numbers if self.rows is None else self.rows[numbers])

    def writer(self, grid: VoxelGrid, axes: Axes) -> Write:
        """Return the function that writes parameters; see `PixelSource`."""
        rays, rows = self.stored, self.rows
        box, shape = corners_and_spacing(grid), in_order(grid.shape, axes)

        def write(start: int, stop: int, parameters: NDArray[np.float64]) -> None:
            some: slice | NDArray[np.int64]
            if rows is None:
                some = slice(int(rays.pixel_ptr[start]), int(rays.pixel_ptr[stop]))
            else:
                _, some = take_groups(rays.pixel_ptr, rows[start:stop])
            of_rays(
                rays.origins[some], rays.directions[some], rays.lengths[some], rays.weight[some],
                box, shape, axes, parameters,
            )  # fmt: skip

        return write
