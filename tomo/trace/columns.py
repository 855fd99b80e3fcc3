"""A volume column by column: the voxels along one axis stand next to each other.

Column ``(b, c)`` of axis ``a`` begins at ``1 + (b * n_c + c) * (n_a + 1)``. Between two columns
stands one spare number, so that the voxel below the first and above the last of a column may be
touched: kernels that take voxels in pairs need no test. It also keeps the columns off steps of
powers of two, at which a processor's cache holds few.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._compile import compiled

_TILE = 16  # voxels along each edge of what is moved together, for both layouts' sake


@compiled(parallel=True)
def _add(source, from_strides, shape, target, to_strides) -> None:
    """Add ``source`` to ``target`` voxel by voxel, tile by tile; ``shape`` is that of the grid."""
    tiles = -(-shape[0] // _TILE)
    for tile in numba.prange(tiles):
        for low_y in range(0, shape[1], _TILE):
            for low_z in range(0, shape[2], _TILE):
                for x in range(tile * _TILE, min(tile * _TILE + _TILE, shape[0])):
                    for y in range(low_y, min(low_y + _TILE, shape[1])):
                        at = x * from_strides[0] + y * from_strides[1] + from_strides[3]
                        to = x * to_strides[0] + y * to_strides[1] + to_strides[3]
                        for z in range(low_z, min(low_z + _TILE, shape[2])):
                            target[to + z * to_strides[2]] += source[at + z * from_strides[2]]


def across(axis: int) -> tuple[int, int]:
    """Return the axes b and c of a long axis."""
    return (1 if axis == 0 else 0), (1 if axis == 2 else 2)


def no_columns(shape: tuple[int, int, int], axis: int, dtype: DTypeLike) -> NDArray:
    """Return a volume of zeros, column by column along ``axis``."""
    b, c = across(axis)
    return np.zeros(1 + shape[b] * shape[c] * (shape[axis] + 1), dtype)


def to_columns(volume: NDArray, shape: tuple[int, int, int], axis: int) -> NDArray:
    """Return a flat volume column by column along ``axis``."""
    columns = no_columns(shape, axis, volume.dtype)
    _add(volume, _in_order(shape), shape, columns, _strides(shape, axis))
    return columns


def add_columns(columns: NDArray, shape: tuple[int, int, int], axis: int, volume: NDArray) -> None:
    """Add to a flat volume what stands column by column along ``axis``."""
    _add(columns, _strides(shape, axis), shape, volume, _in_order(shape))


def _in_order(shape: tuple[int, int, int]) -> tuple[int, int, int, int]:
    return shape[1] * shape[2], shape[2], 1, 0


def _strides(shape: tuple[int, int, int], axis: int) -> tuple[int, int, int, int]:
    """Return the steps along x, y and z, and where the first voxel is."""
    b, c = across(axis)
    steps = [0, 0, 0]
    steps[axis] = 1
    steps[c] = shape[axis] + 1
    steps[b] = steps[c] * shape[c]
    return (*steps, 1)
