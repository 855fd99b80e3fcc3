"""Fewer, larger pixels and voxels: what is found from few images is found as well on these."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid

COARSEST = 24
"""Voxels along the grid's longest edge, and pixels along an image's shortest, left by
default."""


def coarsening(rig: Rig, grid: VoxelGrid, crossings: int, coarsest: int = COARSEST) -> int:
    """Return by how much to enlarge voxels and pixels for about so many crossings.

    ``coarsest`` is what stays at least: voxels along the grid's longest edge, and pixels along an
    image's shortest.
    """
    pixels = sum(math.prod(camera.image_size) for camera in rig)
    wanted = round((pixels * sum(grid.shape) / 3 / crossings) ** (1 / 3))
    most = min(max(grid.shape) // coarsest, min(min(c.image_size) for c in rig) // coarsest)
    return max(min(wanted, most), 1)


def coarser_grid(grid: VoxelGrid, factor: int) -> VoxelGrid:
    """Return the grid of the same box with voxels about ``factor`` times as large."""
    shape = [max(round(n / factor), 1) for n in grid.shape]
    return VoxelGrid.from_bounds(shape, grid.lower, grid.upper)


def shrunk_image(
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
