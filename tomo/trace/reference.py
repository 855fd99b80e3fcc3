"""The oracle: Siddon's algorithm, one ray at a time, in float64.

Siddon, "Fast calculation of the exact radiological path for a three-dimensional CT array",
Medical Physics 12 (1985), equations 2 to 13: cut the ray at every plane between voxels and sort
the cuts. The voxel of each segment follows from the planes passed, not from its midpoint: that of
a short segment next to a plane may round to the plane's other side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.rays.ray_box import enter_box
from tomo.trace.segments import Segments, collect_by_pixel


def planes_ahead(
    position: NDArray[np.float64],
    direction: NDArray[np.float64],
    length: float,
    shape: tuple[int, int, int],
) -> list[NDArray[np.float64]]:
    """Return the distances of the planes between voxels that a ray passes: one array an axis."""
    ahead = []
    for axis in range(3):
        distance = np.zeros(0)
        if direction[axis] != 0:
            with np.errstate(over="ignore"):
                distance = (np.arange(1, shape[axis]) - position[axis]) / direction[axis]
        ahead.append(np.sort(distance[(distance > 0) & (distance < length)]))
    return ahead


def trace(
    rays: Rays, grid: VoxelGrid, *, midpoints: bool = False, dtype: DTypeLike = np.float32
) -> Segments:
    """Trace rays the slow way; see `tomo.trace.trace`."""
    box = enter_box(rays, grid)
    first = box.first_voxel(grid.shape)  # (N, 3)
    step = np.sign(box.direction).astype(np.int64)  # (N, 3)
    counts, lengths, indices, middles = [], [], [], []
    for ray, length in enumerate(box.length):
        if length == 0:
            counts.append(0)
            continue
        position, direction = box.position[ray], box.direction[ray]
        ahead = planes_ahead(position, direction, length, grid.shape)
        cuts = np.unique(np.concatenate([[0.0, length], *ahead]))
        passed = [np.searchsorted(distance, cuts[:-1], side="right") for distance in ahead]
        counts.append(len(cuts) - 1)
        lengths.append(np.diff(cuts))
        indices.append(first[ray] + step[ray] * np.stack(passed, axis=1))  # (segments, 3)
        middle = (cuts[:-1] + cuts[1:]) / 2
        middles.append(position + direction * middle[:, None])  # (segments, 3), voxel units
    return collect_by_pixel(
        rays,
        grid,
        np.array(counts, np.int64),
        np.concatenate([np.zeros(0), *lengths]),
        np.concatenate([np.zeros((0, 3), np.int64), *indices]),
        np.concatenate([np.zeros((0, 3)), *middles]),
        midpoints=midpoints,
        dtype=dtype,
    )
