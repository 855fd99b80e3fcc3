"""Ray sources: pixels with rays, stored here or made when needed (`camera_sources`).

A source has pixels with rays and writes their parameters in a grid
(`tomo.operators.on_the_fly.ray_setup`), some pixels at a time. Taking some of its pixels copies
their numbers only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import take_groups
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.ray_setup import of_rays
from tomo.operators.on_the_fly.running_sums import Axes, in_order
from tomo.rays import Rays

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

    @abstractmethod
    def ray_count(self, start: int, stop: int) -> int:
        """Return how many rays the pixels ``start:stop`` have."""

    @abstractmethod
    def last_within(self, start: int, rays: int) -> int:
        """Return where to stop for ``rays`` rays from pixel ``start`` on, one pixel at least."""

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

    def ray_count(self, start: int, stop: int) -> int:
        """Return how many rays pixels have; see `PixelSource`."""
        return int(self.ray_ptr(start, stop)[-1])

    def last_within(self, start: int, rays: int) -> int:
        """Return where to stop; see `PixelSource`."""
        ptr = self.ray_ptr(start, min(start + rays, self.n_pixels))
        return start + max(int(np.searchsorted(ptr, rays, side="right")) - 1, 1)

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
