"""Checks of the arrays that a box of voxels is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.rotation import numbers


def values_of(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return the finite values of a box of voxels, ``(nx, ny, nz)`` and read-only."""
    try:
        array = np.array(values, np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what}: found {type(values).__name__}, expected numbers") from None
    if array.ndim != 3 or 0 in array.shape:
        raise ValueError(f"{what}: found shape {array.shape}, expected (nx, ny, nz)")
    if not np.isfinite(array).all():
        raise ValueError(f"{what}: found NaN or infinity, expected finite numbers")
    array.setflags(write=False)
    return array


def corner(lower: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a box's lower corner, ``(3,)`` and read-only."""
    return numbers(lower, (3,), f"{what}: lower")


def edges(spacing: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a voxel's edges, ``(3,)`` and read-only; one number serves all."""
    found = numbers(np.broadcast_to(spacing, (3,)), (3,), f"{what}: spacing")
    if not (found > 0).all():
        raise ValueError(f"{what}: spacing: found {found.tolist()}, expected numbers above 0")
    return found
