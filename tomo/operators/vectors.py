"""The vectors that go with an operator, checked: pixels, their weights, and volumes to start from.

An operator ``A`` has ``(pixels, unknowns)`` entries; every loss and every solver takes measured
pixels ``b`` and perhaps a start ``x``, and divides steps by row and column sums of ``A``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.operators.operator import ProjectionOperator

BARELY_MET = 0.1
"""Fraction of the median size of a row below which its step is damped. Lower lets the noise of a
ray that grazes the volume move its voxels far; higher slows rays through few voxels."""


def check_measured(projector: ProjectionOperator, measured: ArrayLike) -> NDArray[np.float32]:
    """Return the measured pixels as a flat float32 vector.

    Raises
    ------
    ValueError
        If there are not as many pixels as the operator has rows, or some are not finite.
    """
    measured = _as_float32(measured).ravel()
    if len(measured) != projector.shape[0]:
        raise ValueError(
            f"measured: found {len(measured)} pixels, expected the projector's "
            f"{projector.shape[0]}"
        )
    wrong = np.count_nonzero(~np.isfinite(measured))
    if wrong:
        raise ValueError(f"measured: found {wrong} NaN or infinite pixels, expected finite ones")
    return measured


def check_weights(
    projector: ProjectionOperator, weights: ArrayLike | None
) -> NDArray[np.float32] | None:
    """Return the weights of the pixels in float32, the largest between 1 and 2; None stays None.

    A common factor changes no least-squares solution, and a power of two changes no digit.

    Raises
    ------
    ValueError
        If there are not as many weights as pixels, or one is negative or not finite.
    """
    if weights is None:
        return None
    weights = np.asarray(weights, np.float64).ravel()
    if len(weights) != projector.shape[0]:
        raise ValueError(
            f"weights: found {len(weights)}, expected one for each of the projector's "
            f"{projector.shape[0]} pixels"
        )
    wrong = np.count_nonzero(~(np.isfinite(weights) & (weights >= 0)))
    if wrong:
        raise ValueError(f"weights: found {wrong} negative, NaN or infinite, expected >= 0")
    largest = float(weights.max(initial=0.0))
    if largest == 0:
        return weights.astype(np.float32)
    return np.ldexp(weights, 1 - int(np.frexp(largest)[1])).astype(np.float32)


def additive_start(
    projector: ProjectionOperator, start: ArrayLike | None, nonnegative: bool
) -> NDArray[np.float32]:
    """Return a copy of ``start`` (unknowns,), or zeros; ``nonnegative`` clips it at zero.

    Otherwise a voxel that no ray meets would stay negative to the end.
    """
    if start is None:
        return np.zeros(projector.shape[1], np.float32)
    start = _checked_start(projector, start)
    return np.maximum(start, 0) if nonnegative else start


def multiplicative_start(
    projector: ProjectionOperator, measured: NDArray[np.float32], start: ArrayLike | None
) -> NDArray[np.float32]:
    """Return a copy of ``start`` (unknowns,), or the constant that gives the sum of the images.

    Voxels that no ray meets start at zero, since no factor would ever change them.

    Raises
    ------
    ValueError
        If the start is negative somewhere, not finite, or of another size than the volume.
    """
    if start is None:
        total = projector.row_sums.sum()
        level = max(float(measured.sum(dtype=np.float64)) / total, 0.0) if total > 0 else 0.0
        return np.where(projector.column_sums > 0, level, 0.0).astype(np.float32)
    start = _checked_start(projector, start)
    if (start < 0).any():
        raise ValueError("start: found negative voxels, expected none for a multiplicative method")
    return start


def by_columns(change: Callable[[NDArray], NDArray], values: NDArray) -> NDArray:
    """Return ``change`` of ``values`` (n,), or of each column of ``values`` (n, columns)."""
    if values.ndim == 1:
        return change(values)
    return np.stack([change(np.ascontiguousarray(one)) for one in values.T], axis=1)


def beside(vector: NDArray, values: NDArray) -> NDArray:
    """Return ``vector`` (n,) in the shape that goes with ``values`` (n,) or (n, columns)."""
    return vector if values.ndim == 1 else vector[:, None]


def unit_of(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the power of two next below the largest magnitude; 1 for a vector of zeros.

    That of each column where there are columns. Division by it is exact, and keeps squares of the
    intensity and sums over large systems inside the range of single precision.
    """
    largest = np.abs(vector).max(axis=0, initial=0.0)
    return np.where(largest > 0, np.ldexp(0.5, np.frexp(largest)[1]), 1.0).astype(np.float32)[()]


def damped(sizes: NDArray[np.floating], fraction: float = BARELY_MET) -> NDArray[np.floating]:
    """Return sizes to divide steps by, each at least a fraction of their median.

    The median is that of the sizes above zero; all are 1 where there is none. A ray that grazes
    the volume has next to no length in it, and the noise of its pixel over so little would throw
    the few voxels that it meets far off. A larger divisor leaves every solution of consistent
    equations as it is.
    """
    above = sizes[sizes > 0]
    return np.maximum(sizes, fraction * float(np.median(above)) if len(above) else 1.0)


def _checked_start(projector: ProjectionOperator, start: ArrayLike) -> NDArray[np.float32]:
    start = _as_float32(start)
    unknowns, voxels = projector.shape[1], projector.grid.size
    if start.size not in (unknowns, voxels) or not np.isfinite(start).all():
        raise ValueError(
            f"start: found shape {start.shape}, expected a finite volume of "
            f"{projector.grid.shape} voxels"
        )
    flat = start.ravel()
    return (projector.active.compress(flat) if start.size == voxels else flat).copy()


def _as_float32(array: ArrayLike) -> NDArray[np.float32]:
    """Return ``array`` in single precision; what is too large becomes infinite, for checks."""
    with np.errstate(over="ignore"):
        return np.asarray(array).astype(np.float32, copy=False)
