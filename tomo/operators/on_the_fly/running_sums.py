"""A volume as running sums along one axis, column by column, and back.

A *column* ``(b, c)`` is the row of ``n_a`` voxels along an axis ``a`` (b and c are the other axes,
in either order). Its running sums ``S[k]``, the sum of its first ``k`` voxels, are ``n_a + 1``
numbers, and column ``(b, c)`` begins at ``(b * n_c + c) * (n_a + 1)``. They are added up in double
precision and kept in the volume's type.

The transpose takes numbers ``D[k]`` that belong to the running sums: voxel ``k`` is in all sums
from ``k + 1`` on, so it gets the sum of ``D`` from there to the column's end. ``D`` is kept in
integers, which sum exactly: what cancels, cancels to zero.

Integers can hold no NaN and no infinity: pixels that are not finite are added apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import run_ranges

Axes = tuple[int, int, int]
"""Which of x, y and z (0, 1, 2) are a, b and c."""

ORDERS: tuple[Axes, ...] = ((0, 1, 2), (1, 0, 2), (2, 0, 1))
"""For each driving axis a, b and c in ascending order."""

TOGETHER = 128
"""Columns or rays of one vectorised loop: fewer cost overhead and use parts of cache lines, more
leave the cache."""


class _Walk(NamedTuple):
    """The order in which a volume and its columns are read.

    Columns are taken side by side along whichever of b and c has its voxels nearer together.

    ``shape`` are the numbers along a, along the other of b and c, and along the one side by
    side; ``voxel`` the strides of the volume along them; ``column`` the columns from one to
    the next along the two.
    """

    shape: tuple[int, int, int]
    voxel: tuple[int, int, int]
    column: tuple[int, int]


@compiled()
def _sum_up(volume, walk, first_other, end_other, sums) -> None:
    """Write the running sums of the columns ``first_other:end_other``."""
    n_a, _, n_side = walk.shape
    step_a, step_other, step_side = walk.voxel
    total = np.zeros(TOGETHER)
    for other in range(first_other, end_other):
        for first in range(0, n_side, TOGETHER):
            some = min(TOGETHER, n_side - first)
            total[:] = 0
            source = other * step_other + first * step_side
            target = (other * walk.column[0] + first * walk.column[1]) * (n_a + 1) + 1
            between = walk.column[1] * (n_a + 1)
            for k in range(n_a):
                for side in range(some):
                    total[side] += volume[np.uint64(source + k * step_a + side * step_side)]
                for side in range(some):
                    sums[np.uint64(target + side * between + k)] = total[side]


@compiled()
def _sum_down(differences, walk, first_other, end_other, start, unit, volume) -> None:
    """Add to the volume, from voxel ``start`` on, the transpose of `_sum_up`."""
    n_a, _, n_side = walk.shape
    step_a, step_other, step_side = walk.voxel
    total = np.zeros(TOGETHER, np.uint64)
    for other in range(first_other, end_other):
        for first in range(0, n_side, TOGETHER):
            some = min(TOGETHER, n_side - first)
            total[:] = 0
            source = (other * walk.column[0] + first * walk.column[1]) * (n_a + 1) + 1
            target = start + other * step_other + first * step_side
            between = walk.column[1] * (n_a + 1)
            for k in range(n_a - 1, -1, -1):
                for side in range(some):
                    total[side] += differences[np.uint64(source + side * between + k)]
                for side in range(some):
                    at = np.uint64(target + k * step_a + side * step_side)
                    volume[at] += np.int64(total[side]) * unit


def in_order(values: tuple[int, int, int], axes: Axes) -> tuple[int, int, int]:
    """Return values of x, y and z in the order a, b, c."""
    a, b, c = (values[axis] for axis in axes)
    return a, b, c


def running_sums(
    volume: NDArray, shape: tuple[int, int, int], axes: Axes
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Return the running sums of a flat volume along a, in single and double precision.

    ``(n_b * n_c * (n_a + 1) + 1,)`` in the volume's type, none in the other. The last one is zero
    and belongs to no column.
    """
    n_a, n_b, n_c = in_order(shape, axes)
    sums = np.zeros(n_b * n_c * (n_a + 1) + 1, volume.dtype)
    walk = _walk(shape, axes, n_b)
    run_ranges(walk.shape[1], lambda first, end: _sum_up(volume, walk, first, end, sums))
    if sums.dtype == np.float32:
        return sums, np.zeros(0)
    return np.zeros(0, np.float32), sums


def add_differences(
    differences: NDArray[np.uint64],
    shape: tuple[int, int, int],
    axes: Axes,
    columns: range,
    unit: float,
    volume: NDArray,
) -> None:
    """Add to a flat volume the transpose of `running_sums` of some columns.

    ``differences`` (columns * n_c * (n_a + 1), or more) are whole numbers of the value
    ``unit``, negative ones as their complement, of the ``columns`` along b.
    """
    walk = _walk(shape, axes, len(columns))
    start = columns[0] * _strides(shape, axes)[1]
    run_ranges(
        walk.shape[1],
        lambda first, end: _sum_down(differences, walk, first, end, start, unit, volume),
    )


def _strides(shape: tuple[int, int, int], axes: Axes) -> tuple[int, int, int]:
    return in_order((shape[1] * shape[2], shape[2], 1), axes)


def _walk(shape: tuple[int, int, int], axes: Axes, some_b: int) -> _Walk:
    """Return the order for ``some_b`` voxels along b, and all along a and c."""
    n_a, _, n_c = in_order(shape, axes)
    a, b, c = _strides(shape, axes)
    if c < b:
        return _Walk((n_a, some_b, n_c), (a, b, c), (n_c, 1))
    return _Walk((n_a, n_c, some_b), (a, c, b), (1, n_c))


def adjoint_with_nonfinite(
    adjoint: Callable[[NDArray], NDArray], y: NDArray, finite: NDArray[np.bool_]
) -> NDArray:
    """Return the adjoint of pixels ``y`` of which some are not ``finite``.

    Their values reach every voxel that they see; ``adjoint`` takes finite pixels only.
    """
    volume = adjoint(np.where(finite, y, 0))
    with np.errstate(invalid="ignore"):  # infinity less infinity is not a number
        for value in np.unique(y[~finite]):
            same = np.isnan(y) if np.isnan(value) else y == value
            volume[adjoint(same.astype(np.float64)) > 0] += value
    return volume
