"""Sources of a camera's rays: made from its pixels when they are needed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, CameraLike
from rigs.aperture import Aperture
from tomo.grid import VoxelGrid
from tomo.operators.on_the_fly.ray_setup import of_pixels
from tomo.operators.on_the_fly.ray_sources import (
    Numbers,
    PixelRuns,
    PixelSource,
    RayPixels,
    Write,
    corners_and_spacing,
)
from tomo.operators.on_the_fly.running_sums import Axes, in_order
from tomo.rays import Rays
from tomo.rays.pixel_rays import (
    points_of_aperture,
    positions_in_pixel,
    rays_of_pixel,
    steps_in_pixel,
)

PIXELS_AT_ONCE = 65_536
"""Pixels whose distortion is computed at once: bounds the working memory to some 10 MB."""


class Averaged(PixelSource):
    """Pixels that are the mean of their rays."""

    pixels: PixelRuns | NDArray[np.int64]

    @property
    def n_pixels(self) -> int:
        """Number of pixels."""
        return len(self.pixels)

    @property
    def largest_weight(self) -> float:
        """One: a pixel's rays are averaged."""
        return 1.0


@dataclass(frozen=True, eq=False)
class CameraPixels(Averaged):
    """Pixels of a camera, whose rays are those of `tomo.rays.Rays.from_camera`.

    ``bend`` is the distortion as in `tomo.operators.on_the_fly.ray_setup.of_pixels`, (B, K², 2)
    float32, for a fisheye (B, K², 3) float64: there the directions themselves, for other lenses
    the correction of the pinhole's image coordinates, which is small and good to 1e-9 in float32;
    (0, 0, 0) for a lens without. ``rows`` (P,) are each pixel's in ``bend``, None: in order.
    """

    camera: Camera
    pixels: PixelRuns
    supersample: int
    bend: NDArray[np.floating]
    rows: NDArray[np.integer] | None = None
    aperture_rays: int = 1

    @classmethod
    def of(
        cls,
        camera: Camera,
        pixels: NDArray[np.integer] | None = None,
        supersample: int = 1,
        aperture_rays: int = 1,
    ) -> CameraPixels:
        """Return the source of some pixels of a camera, or of all."""
        rays_of_pixel(supersample, aperture_rays)
        count = math.prod(camera.image_size)
        bend = _bend(camera, np.arange(count) if pixels is None else pixels, supersample)
        if aperture_rays > 1:
            Aperture.of(camera).check_ahead(camera.name, bend[..., 2:])
        runs = PixelRuns.all_of(count) if pixels is None else PixelRuns.of(pixels, count)
        return cls(camera, runs, supersample, bend, aperture_rays=aperture_rays)

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
        several = rays_of_pixel(self.supersample, self.aperture_rays)
        return np.arange(0, (stop - start) * several + 1, several, dtype=np.int64)

    def rays(self, start: int, stop: int) -> Rays:
        """Return the pixels' rays; see `PixelSource`."""
        some = self.pixels.between(start, stop)
        return Rays.from_camera(self.camera, some, self.supersample, self.aperture_rays)

    def writer(self, grid: VoxelGrid, axes: Axes) -> Write:
        """Return the function that writes parameters; see `PixelSource`."""
        runs, bend, rows = self.pixels, self.bend, self.rows
        (fx, skew, cx), (_, fy, cy) = self.camera.camera_matrix[:2]
        width, steps = self.camera.image_size[0], positions_in_pixel(self.supersample)
        lens = np.array([fx, skew, cx, fy, cy])
        pupil, shares = points_of_aperture(self.supersample, self.aperture_rays)
        focus = math.inf
        if self.aperture_rays > 1:
            aperture = Aperture.of(self.camera)
            pupil, focus = aperture.radius * pupil, aperture.focus_distance
        turn, position = self.camera.R, self.camera.position
        box, shape = corners_and_spacing(grid), in_order(grid.shape, axes)

        def write(start: int, stop: int, parameters: NDArray[np.float64]) -> None:
            some = slice(start, stop) if rows is None else rows[start:stop]
            bent = bend[some] if bend.size else bend
            of_pixels(
                runs.first, runs.ptr, runs.run_of(start), start, stop, bent, width, lens, steps,
                pupil, shares, focus, turn, position, box, shape, axes, parameters,
            )  # fmt: skip

        return write


@dataclass(frozen=True, eq=False)
class GeneratedPixels(Averaged):
    """Pixels whose rays are made anew, by `tomo.rays.Rays.from_camera`, at every use.

    For cameras without a lens model, whose many rays a pixel would fill the memory. ``pixels``
    (P,) are flat numbers ``row * width + column``, ``ptr`` (P + 1,) where each one's rays begin.
    """

    camera: CameraLike
    pixels: NDArray[np.int64]
    ptr: NDArray[np.int64]
    supersample: int
    aperture_rays: int
    grid: VoxelGrid | None

    @classmethod
    def of(
        cls,
        camera: CameraLike,
        pixels: NDArray[np.integer] | None = None,
        supersample: int = 1,
        aperture_rays: int = 1,
        grid: VoxelGrid | None = None,
    ) -> GeneratedPixels:
        """Return the source of some pixels of a camera, or of all."""
        every = np.arange(math.prod(camera.image_size)) if pixels is None else pixels
        numbers = np.asarray(every, np.int64)
        at_once = max(PIXELS_AT_ONCE // rays_of_pixel(supersample, aperture_rays), 1)
        counts = [np.zeros(1, np.int64)]
        for first in range(0, len(numbers), at_once):
            some = numbers[first : first + at_once]
            made = Rays.from_camera(camera, some, supersample, aperture_rays, grid)
            counts.append(np.diff(made.pixel_ptr))
        ptr = np.cumsum(np.concatenate(counts))
        return cls(camera, numbers, ptr, supersample, aperture_rays, grid)

    def take(self, numbers: Numbers) -> GeneratedPixels:
        """Return the source of some of the pixels."""
        ptr = np.concatenate([np.zeros(1, np.int64), np.cumsum(np.diff(self.ptr)[numbers])])
        return replace(self, pixels=self.pixels[numbers], ptr=ptr)

    def ray_ptr(self, start: int, stop: int) -> NDArray[np.int64]:
        """Return where the pixels' rays begin; see `PixelSource`."""
        return self.ptr[start : stop + 1] - self.ptr[start]

    def last_within(self, start: int, rays: int) -> int:
        """Return where to stop; see `PixelSource`."""
        stop = int(np.searchsorted(self.ptr, self.ptr[start] + rays, side="right")) - 1
        return max(stop, start + 1)

    def rays(self, start: int, stop: int) -> Rays:
        """Return the pixels' rays; see `PixelSource`."""
        some, several = self.pixels[start:stop], (self.supersample, self.aperture_rays)
        return Rays.from_camera(self.camera, some, *several, self.grid)

    def writer(self, grid: VoxelGrid, axes: Axes) -> Write:
        """Return the function that writes parameters; see `PixelSource`."""

        def write(start: int, stop: int, parameters: NDArray[np.float64]) -> None:
            made = self.rays(start, stop)
            RayPixels(made).writer(grid, axes)(0, stop - start, parameters)

        return write


def pixel_source(
    camera: CameraLike,
    pixels: NDArray[np.integer] | None = None,
    supersample: int = 1,
    aperture_rays: int = 1,
    grid: VoxelGrid | None = None,
) -> PixelSource:
    """Return the source of some pixels of a camera, or of all.

    The rays of a table and those through a scene are stored; pieces that miss ``grid`` are not.
    With several rays over the aperture they are made when needed.
    """
    if camera.has_lens_model:
        return CameraPixels.of(camera, pixels, supersample, aperture_rays)
    if aperture_rays > 1:
        return GeneratedPixels.of(camera, pixels, supersample, aperture_rays, grid)
    return RayPixels(Rays.from_camera(camera, pixels, supersample, 1, grid))


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
