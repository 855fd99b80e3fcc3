"""From the segments of each ray to `Segments` grouped by pixel, for the two slower tracers."""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._compute.index_types import index_type
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.trace.segments import Segments


def collect_by_pixel(
    rays: Rays,
    grid: VoxelGrid,
    counts: NDArray[np.int64],
    lengths: NDArray[np.float64],
    index: NDArray[np.int64],
    middles: NDArray[np.float64],
    *,
    midpoints: bool,
    dtype: DTypeLike,
) -> Segments:
    """Return `Segments` from those of each ray.

    ``counts`` (N,) of each ray, ``lengths`` (S,), the ``index`` (S, 3) of their voxels and their
    midpoints ``middles`` (S, 3) in voxel units.
    """
    voxel = np.ravel_multi_index(tuple(index.T), grid.shape).astype(index_type(grid.size))
    ray_ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    weighted = lengths * np.repeat(rays.weight, counts)
    from_center = (middles - np.asarray(grid.shape) / 2) * grid.spacing
    return Segments(
        ray_ptr[rays.pixel_ptr],
        voxel,
        weighted.astype(dtype),
        from_center.astype(dtype) if midpoints else None,
    )
