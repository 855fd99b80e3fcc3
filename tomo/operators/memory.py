"""The memory that a reconstruction takes, and whether a stored matrix fits in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from tomo._compute.grouping import golden_ratio_sequence
from tomo._compute.memory import available_memory
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.rays.pixel_rays import rays_of_pixel
from tomo.rays.ray_box import enter_box
from tomo.trace import tracing

STORED, ON_THE_FLY = "stored", "on-the-fly"
"""Forms of a projector: the matrix in memory (`tomo.operators.stored`), or segment lengths
computed at every product (`tomo.operators.on_the_fly`)."""

BYTES_PER_SEGMENT = 20  # an entry, its copy while views are joined, and cross-validation
BYTES_PER_MIDPOINT = 24  # a midpoint, and its copy while views are joined
BYTES_PER_RAY = 32  # on the fly: the pixel's number, the lens distortion, and the images
BYTES_PER_VOXEL = 64  # the volume, its updates and sums, and the column pointers
SAMPLED_RAYS = 2_000
"""Rays of each camera that segments are counted on: fewer err by more than a few per cent."""
SAMPLED_OVER_APERTURE = 4
"""Rays over an aperture that are counted of each pixel: the others are much like them."""
SAMPLED_PIXELS = 128
"""Pixels of each camera whose voxels are counted where rays over an aperture share them: fewer err
by more than a few per cent, more take long."""
LONGEST_TRACED = 2**14
"""Voxels along an axis up to which they are: no matrix of longer grids fits in memory."""


@dataclass(frozen=True)
class MemoryNeed:
    """An estimate of what a reconstruction takes."""

    rays: int  # that meet the grid
    segments: int  # of rays in voxels
    voxels: int
    nbytes: int


def estimate_memory(
    cameras: Sequence[CameraLike],
    grid: VoxelGrid,
    *,
    form: str = STORED,
    supersample: int = 1,
    aperture_rays: int = 1,
    midpoints: bool = False,
) -> MemoryNeed:
    """Estimate the memory of reconstructing from all pixels of some cameras.

    Rays and segments are counted on a sample of the rays; ``form`` is that of the projector.
    """
    several = rays_of_pixel(supersample, aperture_rays)
    over_aperture = min(aperture_rays, SAMPLED_OVER_APERTURE)
    merged = form == STORED and aperture_rays > 1 and not midpoints
    merged = merged and max(grid.shape) <= LONGEST_TRACED
    rays = segments = entries = 0.0
    for camera in cameras:
        count = math.prod(camera.image_size)
        sample, stands_for = _sampled_pixels(count, SAMPLED_RAYS // over_aperture)
        some = Rays.from_camera(camera, sample, 1, over_aperture)
        box = enter_box(some, grid)
        inside = box.length > 0
        counts = box.planes_between(grid.shape)[inside] + 1
        each = stands_for * several / rays_of_pixel(1, over_aperture)
        rays += each * inside.sum()
        segments += each * counts.sum()
        if merged:
            entries += stands_for * _entries(camera, grid, sample, supersample, aperture_rays)
    segments = entries if merged else segments
    per_segment = BYTES_PER_SEGMENT + (BYTES_PER_MIDPOINT if midpoints else 0)
    per_ray = BYTES_PER_RAY * supersample**2 / several  # those over an aperture are made anew
    matrix = per_segment * segments if form == STORED else per_ray * rays
    nbytes = matrix + BYTES_PER_VOXEL * grid.size
    return MemoryNeed(round(rays), round(segments), grid.size, round(nbytes))


def _entries(
    camera: CameraLike,
    grid: VoxelGrid,
    sample: NDArray[np.int64],
    supersample: int,
    aperture_rays: int,
) -> float:
    """Return about how many voxels the rays of the sampled pixels meet, each pixel by itself."""
    some = sample[:: max(len(sample) // SAMPLED_PIXELS, 1)]
    find, found = tracing(grid), 0
    for pixel in some:
        rays = Rays.from_camera(camera, pixel[None], supersample, aperture_rays)
        found += len(np.unique(find(rays).voxel))
    return found * len(sample) / len(some)


def _sampled_pixels(count: int, most: int) -> tuple[NDArray[np.int64], float]:
    """Return some of ``count`` pixels spread over the image, and how many each stands for.

    Even steps would coincide with the image's width and see a few columns only.
    """
    if count <= most:
        return np.arange(count), 1.0
    positions = (np.arange(most) + 0.5) / most * count  # one in each interval
    jitter = (golden_ratio_sequence(most) - 0.5) * count / most
    return np.clip(positions + jitter, 0, count - 1).astype(np.int64), count / most


def _refuse_too_large(need: MemoryNeed, grid: VoxelGrid, form: str, available: int) -> None:
    if need.nbytes <= available:
        return
    coarser = _coarser_grid_that_fits(need, grid, form, available)
    advice = "no grid would fit: use smaller images or fewer rays a pixel"
    if coarser is not None:
        spacing = " x ".join(f"{s:.4g}" for s in coarser.spacing)
        advice = f"{_by(coarser.shape)} voxels of {spacing} would fit"
    raise ValueError(
        f"grid {_by(grid.shape)}: would take about {_gigabytes(need.nbytes)} "
        f"({need.rays:,} rays, {need.segments:,} segments), found {_gigabytes(available)} free; "
        f"{advice}"
    )


def choose_form(
    cameras: Sequence[CameraLike],
    grid: VoxelGrid,
    *,
    wanted: str = "auto",
    needs_matrix: bool = False,
    supersample: int = 1,
    aperture_rays: int = 1,
    midpoints: bool = False,
    available: int | None = None,
) -> tuple[str, str]:
    """Return the form of projector that fits in memory, and the reason, or raise ValueError.

    A stored matrix is the fastest; where it does not fit, segment lengths are computed at every
    product. ``wanted`` is "auto", or the form to take; a method that ``needs_matrix`` takes the
    stored one. ``available`` are the bytes that may be used, what the system has free when None.
    """
    forms = ("auto", STORED, ON_THE_FLY)
    if wanted not in forms:
        raise ValueError(f"projector: found {wanted!r}, expected one of {', '.join(forms)}")
    if wanted == ON_THE_FLY and needs_matrix:
        raise ValueError(
            "projector: found on-the-fly, expected stored: the method needs the matrix entries"
        )
    available = available_memory() if available is None else available
    how: dict[str, Any] = {"supersample": supersample, "aperture_rays": aperture_rays}
    if wanted != ON_THE_FLY:
        most = _most_stored(cameras, grid, rays_of_pixel(**how), midpoints)
        if most <= available:
            return STORED, f"the matrix takes at most {_gigabytes(most)}"
    stored = estimate_memory(cameras, grid, **how, midpoints=midpoints)
    takes = f"the matrix takes about {_gigabytes(stored.nbytes)} of {_gigabytes(available)} free"
    if wanted == STORED or needs_matrix or (wanted == "auto" and stored.nbytes <= available):
        _refuse_too_large(stored, grid, STORED, available)
        return STORED, takes
    flying = estimate_memory(cameras, grid, form=ON_THE_FLY, **how)
    _refuse_too_large(flying, grid, ON_THE_FLY, available)
    return ON_THE_FLY, takes if wanted == "auto" else "asked for"


def _most_stored(
    cameras: Sequence[CameraLike], grid: VoxelGrid, several: int, midpoints: bool
) -> int:
    """Return an upper bound of a stored matrix: a ray has a segment between any two planes."""
    rays = several * sum(math.prod(camera.image_size) for camera in cameras)
    per_segment = BYTES_PER_SEGMENT + (BYTES_PER_MIDPOINT if midpoints else 0)
    return per_segment * rays * (sum(grid.shape) - 2) + BYTES_PER_VOXEL * grid.size


def _coarser_grid_that_fits(
    need: MemoryNeed, grid: VoxelGrid, form: str, available: int
) -> VoxelGrid | None:
    """Return the grid of the same box with larger voxels that takes 80 % of the memory.

    None if even a single layer of voxels takes more.
    """
    per_voxels = BYTES_PER_VOXEL * need.voxels
    rest = max(need.nbytes - per_voxels, 0)
    growth = 1 if form == STORED else 0  # segments grow with the resolution, rays do not
    low, high = 0.0, 1.0
    for _ in range(60):  # bisection
        middle = (low + high) / 2
        taken = per_voxels * middle**3 + rest * middle**growth
        low, high = (middle, high) if taken <= 0.8 * available else (low, middle)
    shape = tuple(math.floor(n * low) for n in grid.shape)
    if min(shape) < 1:
        return None
    return VoxelGrid.from_bounds(shape, grid.lower, grid.upper)


def _gigabytes(nbytes: int) -> str:
    return f"{nbytes / 1e9:,.1f} GB"


def _by(shape: tuple[int, int, int]) -> str:
    return "x".join(str(n) for n in shape)
