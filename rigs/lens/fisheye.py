"""OpenCV's fisheye: an image radius that is a polynomial of the angle off the axis.

Kannala and Brandt, "A generic camera model and calibration method for conventional, wide-angle
and fish-eye lenses" (2006), equation 6, without the asymmetric terms.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigs.lens.perspective import TOLERANCE

_TABLE_SIZE = 4096  # angles from which Newton's method starts


def project(coefficients: tuple[float, ...], points: NDArray) -> tuple[NDArray, NDArray]:
    """Return the plane coordinates ``(N, 2)`` of ``points`` ``(N, 3)`` and their validity."""
    plane = np.full((len(points), 2), np.nan)
    off_axis = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(off_axis, points[:, 2])
    valid = np.isfinite(points).all(axis=1) & (angle < angle_limit(coefficients))
    valid &= (off_axis > 0) | (points[:, 2] > 0)
    radius, _ = _radius(coefficients, angle[valid])
    across = off_axis[valid]
    unit = points[valid, :2] / np.where(across > 0, across, 1.0)[:, None]
    plane[valid] = radius[:, None] * unit
    return plane, valid


def unproject(coefficients: tuple[float, ...], plane: NDArray) -> NDArray[np.float64]:
    """Return the unit directions ``(N, 3)`` seen at ``plane`` ``(N, 2)``; NaN where none is."""
    directions = np.full((len(plane), 3), np.nan)
    target = np.hypot(plane[:, 0], plane[:, 1])
    limit = angle_limit(coefficients)
    table = np.linspace(0.0, limit, _TABLE_SIZE)
    radii, _ = _radius(coefficients, table)
    seen = np.isfinite(target) & (target < radii[-1])
    target = target[seen]
    # The root stays bracketed by two entries of the table, so Newton's step is kept between
    # them and replaced by bisection where it would leave: next to the fold the slope vanishes.
    upper = np.clip(np.searchsorted(radii, target, side="right"), 1, _TABLE_SIZE - 1)
    low, high = table[upper - 1], table[upper]
    angle = np.interp(target, radii, table)
    for _ in range(60):
        radius, slope = _radius(coefficients, angle)
        residual = radius - target
        if (np.abs(residual) <= 1e-16 * (1 + target)).all():
            break
        low = np.where(residual <= 0, angle, low)
        high = np.where(residual >= 0, angle, high)
        step = angle - residual / np.where(slope > 0, slope, 1.0)
        inside = (slope > 0) & (step >= low) & (step <= high)
        angle = np.where(inside, step, (low + high) / 2)
    radius, _ = _radius(coefficients, angle)
    good = (np.abs(radius - target) <= TOLERANCE * (1 + target)) & (angle < limit)
    unit = plane[seen] / np.where(target > 0, target, 1.0)[:, None]
    found = np.concatenate([np.sin(angle)[:, None] * unit, np.cos(angle)[:, None]], axis=1)
    directions[seen] = np.where(good[:, None], found, np.nan)
    return directions


@lru_cache(maxsize=1024)
def angle_limit(coefficients: tuple[float, ...]) -> float:
    """Return the angle off the axis, in radians, up to which the image radius grows."""
    k1, k2, k3, k4 = coefficients
    roots = np.roots([9 * k4, 7 * k3, 5 * k2, 3 * k1, 1.0])  # of the slope, in theta²
    folds = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return min([math.pi, *np.sqrt(folds).tolist()])


def _radius(coefficients: tuple[float, ...], angle: NDArray) -> tuple[NDArray, NDArray]:
    """Return the image radius at ``angle`` and its slope, both ``(N,)``."""
    k1, k2, k3, k4 = coefficients
    q = angle * angle
    radius = angle * (1 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    slope = 1 + q * (3 * k1 + q * (5 * k2 + q * (7 * k3 + q * 9 * k4)))
    return radius, slope
