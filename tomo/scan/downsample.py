"""Fewer, larger pixels and voxels: what is found from few images is found as well on these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, box_points
from tomo.grid import VoxelGrid
from tomo.scan.images import Images, Masks, blocks_of_pixels


def coarsening(rig: Rig, grid: VoxelGrid, segments: int, coarsest: int) -> int:
    """Return by how much to enlarge voxels and pixels for about ``segments`` segments.

    At least ``coarsest`` voxels stay along the grid's longest edge, and pixels along an image's
    shortest. Pixels count in the rectangle that the grid fills: others have no segments.
    """
    pixels = sum(_pixels_on(camera, grid) for camera in rig)
    wanted = round((pixels * sum(grid.shape) / 3 / segments) ** (1 / 3))
    most = min(max(grid.shape) // coarsest, min(min(c.image_size) for c in rig) // coarsest)
    return max(min(wanted, most), 1)


def _pixels_on(camera: CameraLike, grid: VoxelGrid) -> float:
    """Return the pixels of the rectangle that a grid fills of an image."""
    size = np.array(camera.image_size, float)
    uv, _, valid = camera.project(box_points(grid.lower, grid.upper, 2))
    # all where it does not see all corners once, such as behind a mirror
    if not (camera.sees_once and np.all(valid)):
        return float(size.prod())
    low, high = (np.clip(end, -0.5, size - 0.5) for end in (uv.min(axis=0), uv.max(axis=0)))
    return float((high - low).prod())


def coarser_grid(grid: VoxelGrid, factor: int) -> VoxelGrid:
    """Return the grid of the same box with voxels about ``factor`` times as large."""
    shape = [max(round(n / factor), 1) for n in grid.shape]
    return VoxelGrid.from_bounds(shape, grid.lower, grid.upper)


def coarser_images(
    images: Sequence[NDArray], masks: Sequence[NDArray[np.bool_]], factor: int
) -> tuple[Images, Masks]:
    """Return area means of usable pixels, ``(rows, columns)`` each, and where there are any."""
    pairs = [_shrunk(image, mask, factor) for image, mask in zip(images, masks, strict=True)]
    return [image for image, _ in pairs], [mask for _, mask in pairs]


def _shrunk(
    image: NDArray, mask: NDArray, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return area means of the usable pixels, and where there are any."""
    usable = blocks_of_pixels(mask, factor)
    values = blocks_of_pixels(np.where(mask, image, 0), factor)
    count = usable.sum(axis=(1, 3))
    means = values.sum(axis=(1, 3), dtype=np.float64) / np.maximum(count, 1)
    return means.astype(np.float32), count > 0
