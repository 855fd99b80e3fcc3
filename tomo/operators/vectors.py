"""The vectors that go with an operator, checked: pixels, their weights, and volumes to start from.

An operator ``A`` has ``(pixels, unknowns)`` entries; every loss and every solver takes measured
pixels ``b`` and perhaps a start ``x``, and divides steps by row and column sums of ``A``. Pixels,
weights and starts are returned where the operator computes (`ProjectionOperator.array`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import (
    all_finite,
    as_type,
    flat,
    host,
    is_numpy,
    namespace,
    taken,
)
from tomo._compute.reductions import largest, total
from tomo.operators.operator import ProjectionOperator

BARELY_MET = 0.1
"""Fraction of the median size of a row below which its step is damped. Lower lets the noise of a
ray that grazes the volume move its voxels far; higher slows rays through few voxels."""


def check_measured(projector: ProjectionOperator, measured: ArrayLike) -> NDArray[np.float32]:
    """Return the measured pixels, as many as rows and finite, as a flat float32 vector."""
    pixels = flat(_as_float32(projector, measured))
    if pixels.shape[0] != projector.shape[0]:
        raise ValueError(
            f"measured: found {pixels.shape[0]} pixels, expected the projector's "
            f"{projector.shape[0]}"
        )
    xp = namespace(pixels)
    wrong = int(xp.count_nonzero(~xp.isfinite(pixels)))
    if wrong:
        raise ValueError(f"measured: found {wrong} NaN or infinite pixels, expected finite ones")
    return projector.array(pixels)


def check_weights(
    projector: ProjectionOperator, weights: ArrayLike | None
) -> NDArray[np.float32] | None:
    """Return the weights of the pixels, finite and >= 0, in float32; None stays None.

    The largest is between 1 and 2: a common factor changes no least-squares solution, and a power
    of two changes no digit.
    """
    if weights is None:
        return None
    values = flat(as_type(given(projector, weights), np.float64))
    if values.shape[0] != projector.shape[0]:
        raise ValueError(
            f"weights: found {values.shape[0]}, expected one for each of the projector's "
            f"{projector.shape[0]} pixels"
        )
    xp = namespace(values)
    wrong = int(xp.count_nonzero(~(xp.isfinite(values) & (values >= 0))))
    if wrong:
        raise ValueError(f"weights: found {wrong} negative, NaN or infinite, expected >= 0")
    heaviest = float(largest(values))
    if heaviest > 0:
        power = 1 - math.frexp(heaviest)[1]
        for part in (power // 2, power - power // 2):  # all of it may overflow
            values = values * math.ldexp(1.0, part)
    return projector.array(as_type(values, np.float32))


def additive_start(
    projector: ProjectionOperator, start: ArrayLike | None, nonnegative: bool
) -> NDArray[np.float32]:
    """Return a copy of ``start`` (unknowns,), or zeros; ``nonnegative`` clips it at zero.

    Otherwise a voxel that no ray meets would stay negative to the end.
    """
    if start is None:
        return projector.array(np.zeros(projector.shape[1], np.float32))
    found = _checked_start(projector, start)
    return namespace(found).maximum(found, 0.0) if nonnegative else found


def multiplicative_start(
    projector: ProjectionOperator, measured: NDArray[np.float32], start: ArrayLike | None
) -> NDArray[np.float32]:
    """Return a copy of ``start`` (unknowns,), or the constant that gives the sum of the images.

    Negative voxels are refused. Those that no ray meets start at zero: no factor changes them.
    """
    if start is None:
        lengths = projector.row_sums.sum()
        level = max(float(total(measured)) / lengths, 0.0) if lengths > 0 else 0.0
        seen = np.where(projector.column_sums > 0, level, 0.0).astype(np.float32)
        return projector.array(seen)
    found = _checked_start(projector, start)
    if bool(namespace(found).any(found < 0)):
        raise ValueError("start: found negative voxels, expected none for a multiplicative method")
    return found


def by_columns(change: Callable[[NDArray], NDArray], values: NDArray) -> NDArray:
    """Return ``change`` of ``values`` (n,), or of each column of ``values`` (n, columns)."""
    if values.ndim == 1:
        return change(values)
    columns = [change(_column(values, number)) for number in range(values.shape[1])]
    return namespace(columns[0]).stack(columns, axis=1)


def beside(vector: NDArray, values: NDArray) -> NDArray:
    """Return ``vector`` (n,) in the shape that goes with ``values`` (n,) or (n, columns)."""
    return vector if values.ndim == 1 else vector[:, None]


def _column(values: NDArray, number: int) -> NDArray:
    column = values[:, number]
    return np.ascontiguousarray(column) if is_numpy(column) else column


def unit_of(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the power of two next below the largest magnitude; 1 for a vector of zeros.

    That of each column where there are columns. Division by it is exact, and keeps squares of the
    intensity and sums over large systems inside the range of single precision.
    """
    brightest = largest(namespace(vector).abs(vector))
    unit = np.where(brightest > 0, np.ldexp(0.5, np.frexp(brightest)[1]), 1.0)
    return unit.astype(np.float32)[()]


def damped(sizes: NDArray[np.floating], fraction: float = BARELY_MET) -> NDArray[np.floating]:
    """Return sizes to divide steps by, each at least a fraction of the median of those above zero.

    All are 1 where there is none. A ray that grazes the volume has next to no length in it, and
    its pixel's noise over so little would throw the few voxels that it meets far off. Larger
    divisors leave every solution of consistent equations as it is.
    """
    above = sizes[sizes > 0]
    return np.maximum(sizes, fraction * float(np.median(above)) if len(above) else 1.0)


def _checked_start(projector: ProjectionOperator, start: ArrayLike) -> NDArray[np.float32]:
    found = _as_float32(projector, start)
    unknowns, voxels = projector.shape[1], projector.grid.size
    values = flat(found)
    if values.shape[0] not in (unknowns, voxels) or not all_finite(values):
        raise ValueError(
            f"start: found shape {tuple(found.shape)}, expected a finite volume of "
            f"{projector.grid.shape} voxels"
        )
    if values.shape[0] == voxels and projector.active.index is not None:
        values = taken(values, projector.active.index)
    there = projector.array(values)
    return namespace(there).asarray(there, copy=True)


def _as_float32(projector: ProjectionOperator, array: ArrayLike) -> Any:
    """Return ``array`` in single precision; what is too large becomes infinite, for checks."""
    with np.errstate(over="ignore"):
        return as_type(given(projector, array), np.float32)


def given(projector: ProjectionOperator, array: Any) -> Any:
    """Return an array where it is, if the operator computes there; else in NumPy's."""
    return array if projector.takes(array) else host(array)
