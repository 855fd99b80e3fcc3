"""Fewer, larger pixels and voxels: what is found from few images is found as well on these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, box_points
from tomo.grid import VoxelGrid

COARSEST = 24
"""Voxels along the grid's longest edge, and pixels along an image's shortest, left by
default."""


@dataclass(frozen=True, eq=False)
class Coarser:
    """Cameras, their images ``(rows, columns)`` and a grid, with larger pixels and voxels."""

    rig: Rig
    images: tuple[NDArray[np.float32], ...]
    masks: tuple[NDArray[np.bool_], ...]  # True where any pixel was usable
    grid: VoxelGrid
    factor: int  # how many pixels a large one is wide

    @classmethod
    def of(
        cls,
        rig: Rig,
        images: Sequence[NDArray],
        masks: Sequence[NDArray[np.bool_]],
        grid: VoxelGrid,
        factor: int,
    ) -> Self:
        """Return what becomes of images ``(height, width)`` and the rest, see `coarsening`."""
        pairs = [_shrunk(i, m, factor) for i, m in zip(images, masks, strict=True)]
        return cls(
            replace(rig, cameras=tuple(camera.shrunk(factor) for camera in rig)),
            tuple(image for image, _ in pairs),
            tuple(mask for _, mask in pairs),
            coarser_grid(grid, factor),
            factor,
        )


def coarsening(rig: Rig, grid: VoxelGrid, segments: int, coarsest: int = COARSEST) -> int:
    """Return by how much to enlarge voxels and pixels for about ``segments`` segments.

    At least ``coarsest`` voxels stay along the grid's longest edge, and pixels along an image's
    shortest. Pixels count in the rectangle that the grid fills: others have no segments.
    """
    pixels = sum(_pixels_on(camera, grid) for camera in rig)
    wanted = round((pixels * sum(grid.shape) / 3 / segments) ** (1 / 3))
    most = min(max(grid.shape) // coarsest, min(min(c.image_size) for c in rig) // coarsest)
    return max(min(wanted, most), 1)


def _pixels_on(camera: CameraLike, grid: VoxelGrid) -> float:
    """Return the pixels of the rectangle that a grid fills of an image.

    All of a camera that does not see all of the grid's corners once, such as behind a mirror.
    """
    size = np.array(camera.image_size, float)
    uv, _, valid = camera.project(box_points(grid.lower, grid.upper, 2))
    if not (camera.sees_once and np.all(valid)):
        return float(size.prod())
    low, high = (np.clip(end, -0.5, size - 0.5) for end in (uv.min(axis=0), uv.max(axis=0)))
    return float((high - low).prod())


def coarser_grid(grid: VoxelGrid, factor: int) -> VoxelGrid:
    """Return the grid of the same box with voxels about ``factor`` times as large."""
    shape = [max(round(n / factor), 1) for n in grid.shape]
    return VoxelGrid.from_bounds(shape, grid.lower, grid.upper)


def _shrunk(
    image: NDArray, mask: NDArray, factor: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return area means of the usable pixels, and where there are any."""
    rows, columns = (side // factor for side in image.shape)
    whole = (slice(rows * factor), slice(columns * factor))
    blocks = (rows, factor, columns, factor)
    usable = mask[whole].reshape(blocks)
    values = np.where(mask, image, 0)[whole].reshape(blocks)
    count = usable.sum(axis=(1, 3))
    means = values.sum(axis=(1, 3), dtype=np.float64) / np.maximum(count, 1)
    return means.astype(np.float32), count > 0
