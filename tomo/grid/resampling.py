"""Values between voxels, and on other voxels; outside their grid they are zero."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.grid.voxel_grid import VoxelGrid

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def interpolated(values: NDArray, grid: VoxelGrid, points: ArrayLike) -> NDArray[np.float64]:
    """Return the values ``(...)`` at points ``(..., 3)``, linear between voxel centres.

    Zero at the centres of voxels around the grid.
    """
    from scipy.ndimage import map_coordinates

    points = np.asarray(points, np.float64)
    if points.shape[-1:] != (3,):
        raise ValueError(f"points: found shape {points.shape}, expected (..., 3)")
    index = (points - grid.origin) / grid.spacing
    found = map_coordinates(
        values, np.moveaxis(index, -1, 0).reshape(3, -1), np.float64, order=1,
        mode="grid-constant",
    )  # fmt: skip
    return found.reshape(index.shape[:-1])


def resampled(values: NDArray, grid: VoxelGrid, other: VoxelGrid) -> NDArray:
    """Return values ``(nx, ny, nz)``, means over the voxels of one grid, on those of another.

    Along each axis a new voxel is the mean over ``x - w / 2`` to ``x + w / 2`` about its centre,
    where ``w`` is the larger of both edge lengths: old voxels count by what is common to both.
    That keeps the total where new voxels are larger, and is linear interpolation where they are as
    large or smaller. In the precision of the values; integers become float64.
    """
    found = values
    for axis in range(3):
        weights = _weights(grid, other, axis)
        moved = np.moveaxis(found, axis, 0)
        product = weights @ moved.reshape(len(moved), -1)
        found = np.moveaxis(product.reshape(-1, *moved.shape[1:]), 0, axis)
    return np.ascontiguousarray(found, np.result_type(values.dtype, np.float32))


def _weights(grid: VoxelGrid, other: VoxelGrid, axis: int) -> csr_array:
    """Return the sparse matrix ``(new, old)`` of an axis."""
    from scipy.sparse import csr_array

    edge = grid.spacing[axis]
    width = max(edge, other.spacing[axis])
    middles = (other.axes()[axis] - grid.lower[axis]) / edge  # in old voxels
    half = width / edge / 2
    lows, highs = middles - half, middles + half
    rows, columns, parts = [], [], []
    first, last = np.floor(lows).astype(np.int64), np.ceil(highs).astype(np.int64)
    for row, (low, high) in enumerate(zip(lows, highs, strict=True)):
        old = np.arange(max(first[row], 0), min(last[row], grid.shape[axis]))
        part = np.minimum(high, old + 1) - np.maximum(low, old)
        keep = part > 1e-9  # rounding at a face
        rows.append(np.full(keep.sum(), row))
        columns.append(old[keep])
        parts.append(part[keep] / (2 * half))
    placed = np.concatenate(rows), np.concatenate(columns)
    shape = other.shape[axis], grid.shape[axis]
    return csr_array((np.concatenate(parts), placed), shape)
