"""Checks of the arrays that a table of rays is made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.rotation import numbers

_JUMP = 8.0  # times the median step between pixels; larger ones separate two views
_EXACT = 4e-16  # directions closer to length one are kept bit by bit


def unit_or_nan(
    directions: NDArray[np.float64], origins: NDArray[np.float64], what: str
) -> NDArray[np.float64]:
    """Return ``directions`` ``(h, w, 3)`` as unit vectors, NaN where a ray is incomplete."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(directions, axis=2, keepdims=True)
    if (length == 0).any():
        raise ValueError(f"{what}: found a zero vector, expected none")
    seen = np.isfinite(length[..., 0]) & np.isfinite(origins).all(axis=2)
    if not seen.any():
        raise ValueError(f"{what}: found no finite ray, expected at least one")
    length[np.abs(length - 1) <= _EXACT] = 1.0
    with np.errstate(invalid="ignore"):
        unit = np.where(seen[..., None], directions / length, np.nan)
    unit.setflags(write=False)
    return unit


def vectors(value: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return ``value`` as an array of vectors ``(h, w, 3)``."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what}: found {type(value).__name__}, expected numbers") from None
    if array.ndim != 3 or array.shape[2] != 3 or 0 in array.shape:
        raise ValueError(f"{what}: found shape {array.shape}, expected (height, width, 3)")
    return array


def origins_for(value: ArrayLike, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """Return origins of rays, read-only ``shape``; one for all takes the memory of one."""
    if np.shape(value) == (3,):
        return np.broadcast_to(numbers(value, (3,), what), shape)
    array = np.asarray(value)
    if array.shape == shape and array.dtype == np.float64 and not array.flags.writeable:
        return array  # checked before; it may be shared
    array = vectors(value, what)
    if array.shape != shape:
        raise ValueError(f"{what}: found shape {array.shape}, expected {shape} or (3,)")
    array.setflags(write=False)
    return array


def view_labels(directions: NDArray[np.float64]) -> NDArray[np.integer]:
    """Return the label from 1 of the connected view of each pixel ``(h, w)``; 0 between views.

    Pixels without a ray part views, and steps between directions far larger than the median.
    """
    from scipy.ndimage import label

    joined = np.isfinite(directions[..., 0])
    steps = [np.linalg.norm(np.diff(directions, axis=axis), axis=2) for axis in (0, 1)]
    known = np.concatenate([step[np.isfinite(step)] for step in steps])
    if len(known):
        limit = _JUMP * float(np.median(known)) + 1e-12
        with np.errstate(invalid="ignore"):
            joined[:-1] &= ~(steps[0] > limit)
            joined[:, :-1] &= ~(steps[1] > limit)
    return label(joined)[0]


def in_largest_view(labels: NDArray[np.integer], xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether table pixels ``(N, 2)`` are in the largest of its views, ``(N,)``."""
    height, width = labels.shape
    x, y = np.clip(np.rint(xy).astype(int), 0, [width - 1, height - 1]).T
    return labels[y, x] == 1 + np.bincount(labels.ravel())[1:].argmax()


def finite_or_zero(origins: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return origins with zeros where one is not finite."""
    return np.where(np.isfinite(origins).all(axis=1, keepdims=True), origins, 0.0)
