"""From the crossings of each ray to Segments grouped by pixel; shared by the slower tracers."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.segments import Segments


def voxel_dtype(grid: VoxelGrid) -> np.dtype:
    """Return the smallest integer type that numbers all voxels of the grid."""
    return np.dtype(np.int32 if grid.size <= np.iinfo(np.int32).max else np.int64)


def collect_by_pixel(
    rays: Rays,
    grid: VoxelGrid,
    counts: NDArray[np.int64],
    lengths: NDArray[np.float64],
    middles: NDArray[np.float64],
    *,
    midpoints: bool,
    dtype: DTypeLike,
) -> Segments:
    """Return Segments from ``counts`` (N,), ``lengths`` (S,) and ``middles`` (S, 3), ray by ray.

    ``middles`` are in voxel units; the voxel of a crossing is the one its middle lies in, so that
    a ray along a face belongs to the voxel above, and to the last one on the upper outer face.
    """
    index = np.clip(np.floor(middles), 0, np.asarray(grid.shape) - 1).astype(np.int64)
    voxel = np.ravel_multi_index(tuple(index.T), grid.shape).astype(voxel_dtype(grid))
    ray_ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    weighted = lengths * np.repeat(rays.weight, counts)
    from_center = (middles - np.asarray(grid.shape) / 2) * grid.spacing
    return Segments(
        ray_ptr[rays.pixel_ptr],
        voxel,
        weighted.astype(dtype),
        from_center.astype(dtype) if midpoints else None,
    )
