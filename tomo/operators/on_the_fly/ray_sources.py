"""Ray sources: rays that are stored, or made from a camera's pixels when they are needed.

A source has pixels with rays and writes their parameters in a grid
(`tomo.operators.on_the_fly.ray_setup`), some pixels at a time. Taking some of its pixels copies
their numbers only.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, CameraLike
from tomo._compute.grouping import take_groups
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.pixel_runs import PixelRuns
from tomo.operators.on_the_fly.ray_setup import of_pixels, of_rays
from tomo.operators.on_the_fly.running_sums import Axes, in_order
from tomo.rays import Rays
from tomo.rays.rays import positions_in_pixel, steps_in_pixel

PIXELS_AT_ONCE = 65_536
"""Pixels whose distortion is computed at once: bounds the working memory to some 10 MB."""

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
            if rows is None:
                some = slice(int(rays.pixel_ptr[start]), int(rays.pixel_ptr[stop]))
            else:
                _, some = take_groups(rays.pixel_ptr, rows[start:stop])
            of_rays(
                rays.origins[some], rays.directions[some], rays.lengths[some], rays.weight[some],
                box, shape, axes, parameters,
            )  # fmt: skip

        return write


@dataclass(frozen=True, eq=False)
class CameraPixels(PixelSource):
    """Pixels of a camera, whose rays are those of `tomo.rays.Rays.from_camera`.

    Attributes
    ----------
    camera : Camera
    pixels : PixelRuns
        Flat pixel numbers ``row * width + column``.
    supersample : int
        Rays along each side of a pixel.
    bend : (B, K², 2) float32, (B, K², 3) float64 or (0, 0, 0)
        Distortion, as in `tomo.operators.on_the_fly.ray_setup.of_pixels`: for a fisheye the
        directions themselves, for other lenses the correction of the pinhole's image coordinates,
        which is small and good to 1e-9 in float32. Empty for a lens without distortion.
    rows : (P,) int, optional
        The row of ``bend`` of each pixel; None where they are in order.
    """

    camera: Camera
    pixels: PixelRuns
    supersample: int
    bend: NDArray[np.floating]
    rows: NDArray[np.integer] | None = None

    @classmethod
    def of(
        cls, camera: Camera, pixels: NDArray[np.integer] | None = None, supersample: int = 1
    ) -> CameraPixels:
        """Return the source of some pixels of a camera, or of all.

        Raises
        ------
        ValueError
            If ``supersample`` is below one.
        """
        if supersample < 1:
            raise ValueError(f"supersample: found {supersample}, expected a whole number >= 1")
        count = math.prod(camera.image_size)
        bend = _bend(camera, np.arange(count) if pixels is None else pixels, supersample)
        runs = PixelRuns.all_of(count) if pixels is None else PixelRuns.of(pixels, count)
        return cls(camera, runs, supersample, bend)

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return len(self.pixels)

    @property
    def largest_weight(self) -> float:
        """One: a pixel's rays are averaged."""
        return 1.0

    def take(self, numbers: Numbers) -> CameraPixels:
        """Return the source of some of the pixels."""
        every = self.pixels.between(0, self.n_pixels)
        pixels = PixelRuns.of(every[numbers], math.prod(self.camera.image_size))
        if not self.bend.size:
            return replace(self, pixels=pixels)
        rows = np.arange(len(self.bend), dtype=np.int32) if self.rows is None else self.rows
        return replace(self, pixels=pixels, rows=rows[numbers])

    def ray_ptr(self, start: int, stop: int) -> NDArray[np.int64]:
        """Return where the pixels' rays begin; see `PixelSource`."""
        several = self.supersample**2
        return np.arange(0, (stop - start) * several + 1, several, dtype=np.int64)

    def ray_count(self, start: int, stop: int) -> int:
        """Return how many rays pixels have; see `PixelSource`."""
        return (stop - start) * self.supersample**2

    def last_within(self, start: int, rays: int) -> int:
        """Return where to stop; see `PixelSource`."""
        return min(start + max(rays // self.supersample**2, 1), self.n_pixels)

    def rays(self, start: int, stop: int) -> Rays:
        """Return the pixels' rays; see `PixelSource`."""
        return Rays.from_camera(self.camera, self.pixels.between(start, stop), self.supersample)

    def writer(self, grid: VoxelGrid, axes: Axes) -> Write:
        """Return the function that writes parameters; see `PixelSource`."""
        runs, bend, rows = self.pixels, self.bend, self.rows
        (fx, skew, cx), (_, fy, cy) = self.camera.camera_matrix[:2]
        width, steps = self.camera.image_size[0], positions_in_pixel(self.supersample)
        lens = np.array([fx, skew, cx, fy, cy])
        turn, position = self.camera.R, self.camera.position
        box, shape = corners_and_spacing(grid), in_order(grid.shape, axes)

        def write(start: int, stop: int, parameters: NDArray[np.float64]) -> None:
            some = slice(start, stop) if rows is None else rows[start:stop]
            bent = bend[some] if bend.size else bend
            of_pixels(
                runs.first, runs.ptr, runs.run_of(start), start, stop, bent, width, lens, steps,
                turn, position, box, shape, axes, parameters,
            )  # fmt: skip

        return write


def pixel_source(
    camera: CameraLike,
    pixels: NDArray[np.integer] | None = None,
    supersample: int = 1,
    grid: VoxelGrid | None = None,
) -> PixelSource:
    """Return the source of some pixels of a camera, or of all.

    The rays of a table and those through a scene are stored; pieces that miss ``grid`` are not.
    """
    if not camera.has_lens_model:
        return RayPixels(Rays.from_camera(camera, pixels, supersample, grid))
    return CameraPixels.of(camera, pixels, supersample)


def _bend(
    camera: Camera, pixels: NDArray[np.integer], supersample: int
) -> NDArray[np.float32] | NDArray[np.float64]:
    """Return the distortion of pixels' rays; see `CameraPixels`."""
    if camera.is_pinhole:
        return np.zeros((0, 0, 0), np.float32)
    fisheye = camera.distortion.model == "fisheye"
    shape = (len(pixels), supersample**2, 3 if fisheye else 2)
    bend = np.zeros(shape, np.float64 if fisheye else np.float32)
    (fx, skew, cx), (_, fy, cy) = camera.camera_matrix[:2]
    steps = steps_in_pixel(supersample)
    width = camera.image_size[0]
    at_once = max(PIXELS_AT_ONCE // supersample**2, 1)
    for first in range(0, len(pixels), at_once):
        some = slice(first, first + at_once)
        down = (pixels[some] // width)[:, None, None] + steps[:, None]  # (P, K, 1)
        right = (pixels[some] % width)[:, None, None] + steps  # (P, 1, K)
        y = np.broadcast_to((down - cy) / fy, (len(down), supersample, supersample))
        x = (right - cx - skew * y) / fx
        plane = np.stack([x, y], axis=-1).reshape(-1, 2)
        seen = camera.distortion.unproject(plane)  # (P * K², 3)
        if not fisheye:
            seen = seen[:, :2] / seen[:, 2:] - plane
        bend[some] = seen.reshape(-1, *shape[1:])
    return bend
