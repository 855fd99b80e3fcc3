"""A volume as running sums along one axis, column by column, and back.

A *column* ``(b, c)`` is the row of ``n_a`` voxels along an axis ``a`` (b and c are the other axes
in their order). Its running sums ``S[k]``, the sum of its first ``k`` voxels, are ``n_a + 1``
numbers, and column ``(b, c)`` begins at ``(b * n_c + c) * (n_a + 1)``. They are added up in double
precision and kept in the volume's type.

The transpose takes numbers ``D[k]`` that belong to the running sums: voxel ``k`` is in all sums
from ``k + 1`` on, so it gets the sum of ``D`` from there to the column's end. ``D`` is kept in
whole numbers, for which that sum is exact: what cancels, cancels to zero.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compile import compiled

_TOGETHER = 16  # columns that are gone through side by side, for the volume's layout's sake


@compiled(parallel=True)
def _sum_up(volume, strides, shape, sums) -> None:
    """Write the running sums of all columns; ``strides`` are the volume's along a, b, c."""
    length = shape[0] + 1
    for b in numba.prange(shape[1]):
        total = np.zeros(_TOGETHER)
        for first in range(0, shape[2], _TOGETHER):
            some = min(_TOGETHER, shape[2] - first)
            total[:] = 0
            source = b * strides[1] + first * strides[2]
            target = (b * shape[2] + first) * length
            for k in range(shape[0]):
                for c in range(some):
                    total[c] += volume[source + k * strides[0] + c * strides[2]]
                    sums[target + c * length + k + 1] = total[c]


@compiled(parallel=True)
def _sum_down(differences, strides, shape, first_b, unit, volume) -> None:
    """Add to the volume the transpose of `_sum_up` for some of the columns."""
    length = shape[0] + 1
    for b in numba.prange(len(differences) // (length * shape[2])):
        total = np.zeros(_TOGETHER, np.uint64)
        for first in range(0, shape[2], _TOGETHER):
            some = min(_TOGETHER, shape[2] - first)
            total[:] = 0
            source = (b * shape[2] + first) * length
            target = (first_b + b) * strides[1] + first * strides[2]
            for k in range(shape[0] - 1, -1, -1):
                for c in range(some):
                    total[c] += differences[source + c * length + k + 1]
                    volume[target + k * strides[0] + c * strides[2]] += np.int64(total[c]) * unit


def turned(values: tuple[int, int, int], axis: int) -> tuple[int, int, int]:
    """Return what belongs to x, y and z in the order of a long axis a, b and c."""
    b, c = across(axis)
    return values[axis], values[b], values[c]


def across(axis: int) -> tuple[int, int]:
    """Return the axes b and c of a long axis."""
    return (1 if axis == 0 else 0), (1 if axis == 2 else 2)


def running_sums(
    volume: NDArray, shape: tuple[int, int, int], axis: int
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the running sums of a flat volume along ``axis``, in single and double precision.

    ``(n_b * n_c * (n_a + 1) + 2,)`` in the volume's type, none in the other. The last two are
    zero and belong to no column.
    """
    n_a, n_b, n_c = turned(shape, axis)
    sums = np.zeros(n_b * n_c * (n_a + 1) + 2, volume.dtype)
    _sum_up(volume, _strides(shape, axis), (n_a, n_b, n_c), sums)
    if sums.dtype == np.float32:
        return sums, np.zeros(0)
    return np.zeros(0, np.float32), sums


def add_differences(
    differences: NDArray[np.uint64],
    shape: tuple[int, int, int],
    axis: int,
    first_b: int,
    unit: float,
    volume: NDArray,
) -> None:
    """Add to a flat volume the transpose of `running_sums` of some columns.

    Parameters
    ----------
    differences : (columns * (n_a + 1),) uint64
        Whole numbers, negative ones as their complement, of the columns from ``(first_b, 0)`` on.
    shape : (int, int, int)
    axis, first_b : int
    unit : float
        What one of the whole numbers stands for.
    volume : (voxels,) float32 or float64
    """
    _sum_down(differences, _strides(shape, axis), turned(shape, axis), first_b, unit, volume)


def _strides(shape: tuple[int, int, int], axis: int) -> tuple[int, int, int]:
    return turned((shape[1] * shape[2], shape[2], 1), axis)
