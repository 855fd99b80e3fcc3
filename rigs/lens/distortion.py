"""Lens distortion: OpenCV's models behind one pair of maps; the lens of a turned image."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigs.lens import perspective
from rigs.lens.perspective import TOLERANCE, sensor_rotation

#: Permitted numbers of coefficients of each model.
COEFFICIENT_COUNTS: dict[str, tuple[int, ...]] = {
    "none": (0,),
    "brown": (4, 5),
    "rational": (8,),
    "thin_prism": (12,),
    "tilted": (14,),
    "fisheye": (4,),
}


@dataclass(frozen=True)
class Distortion:
    """A lens model and its coefficients, on the image plane at distance one.

    Parameters
    ----------
    model : {"none", "brown", "rational", "thin_prism", "tilted", "fisheye"}
        OpenCV's models. All but ``fisheye`` see only points in front of the camera.
    coefficients : sequence of float
        In OpenCV's order. ``brown``: k1 k2 p1 p2 [k3]; ``rational`` adds k4 k5 k6,
        ``thin_prism`` adds s1 s2 s3 s4, ``tilted`` adds the sensor's tilts tau_x tau_y in
        radians. ``fisheye``: k1 k2 k3 k4 of theta_d = theta (1 + k1 theta² + ...).

    Raises
    ------
    ValueError
        If the model is unknown, the count is not the model's, or a coefficient is not finite.

    Notes
    -----
    Distortion polynomials fold: beyond some angle the image moves back, and two directions share
    a pixel. The *domain* of a lens extends from the axis to the first fold in each direction: on
    the straight line from the axis the symmetric part of the Jacobian is positive definite. Both
    maps are restricted to it, so each is the other's inverse.

    Examples
    --------
    >>> Distortion("brown", (-0.2, 0.05, 0.0, 0.0))
    Distortion(model='brown', coefficients=(-0.2, 0.05, 0.0, 0.0))
    """

    model: str = "none"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Normalise to plain floats, so that distortions compare, hash and print as values."""
        if not isinstance(self.model, str) or self.model not in COEFFICIENT_COUNTS:
            raise ValueError(
                f"distortion.model: found {self.model!r}, "
                f"expected one of {', '.join(COEFFICIENT_COUNTS)}"
            )
        coefficients = _finite(self.coefficients)
        counts = COEFFICIENT_COUNTS[self.model]
        if len(coefficients) not in counts:
            raise ValueError(
                f"distortion.coefficients: found {len(coefficients)} for model {self.model}, "
                f"expected {' or '.join(str(n) for n in counts)}"
            )
        if self.model == "tilted" and max(abs(tau) for tau in coefficients[12:]) >= math.pi / 2:
            raise ValueError(
                f"distortion.coefficients: found tilts {coefficients[12]} and {coefficients[13]}"
                " rad for model tilted, expected less than a right angle"
            )
        object.__setattr__(self, "coefficients", coefficients)

    def project(self, points: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        """Return the image plane coordinates ``(N, 2)`` of points ``(N, 3)``, and their validity.

        Points are in the camera's axes: x right, y down, z forward. Coordinates are in focal
        lengths, NaN where not valid: outside the lens's domain, or behind the camera, except for a
        fisheye.
        """
        if self.model == "fisheye":
            return _project_fisheye(self.coefficients, points)
        return perspective.project(self.coefficients, points)

    def unproject(self, plane: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the unit vectors ``(N, 3)`` seen at ``plane`` ``(N, 2)``; NaN where none is."""
        if self.model == "fisheye":
            return _unproject_fisheye(self.coefficients, plane)
        return perspective.unproject(self.coefficients, plane)


def _finite(coefficients: Iterable[float]) -> tuple[float, ...]:
    """Return ``coefficients`` as plain floats, or say which of them is no finite number."""
    try:
        values = tuple(float(c) for c in np.asarray(coefficients, np.float64).reshape(-1))
    except (TypeError, ValueError, OverflowError):
        raise ValueError(
            f"distortion.coefficients: found {coefficients!r}, expected numbers"
        ) from None
    for index, value in enumerate(values):
        if not math.isfinite(value):
            raise ValueError(
                f"distortion.coefficients: found {value} at position {index}, "
                "expected finite numbers"
            )
    return values


_TABLE_SIZE = 4096  # angles from which Newton's method starts


def _project_fisheye(coefficients: tuple[float, ...], points: NDArray) -> tuple[NDArray, NDArray]:
    """Return plane coordinates ``(N, 2)`` and validity: the radius is a polynomial of the angle.

    Kannala and Brandt, "A generic camera model and calibration method for conventional,
    wide-angle and fish-eye lenses" (2006), equation 6, without the asymmetric terms.
    """
    plane = np.full((len(points), 2), np.nan)
    off_axis = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(off_axis, points[:, 2])
    valid = np.isfinite(points).all(axis=1) & (angle < _angle_limit(coefficients))
    valid &= (off_axis > 0) | (points[:, 2] > 0)
    radius, _ = _radius(coefficients, angle[valid])
    across = off_axis[valid]
    unit = points[valid, :2] / np.where(across > 0, across, 1.0)[:, None]
    plane[valid] = radius[:, None] * unit
    return plane, valid


def _unproject_fisheye(coefficients: tuple[float, ...], plane: NDArray) -> NDArray[np.float64]:
    """Return the unit directions ``(N, 3)`` seen at ``plane`` ``(N, 2)``; NaN where none is."""
    directions = np.full((len(plane), 3), np.nan)
    target = np.hypot(plane[:, 0], plane[:, 1])
    limit = _angle_limit(coefficients)
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
def _angle_limit(coefficients: tuple[float, ...]) -> float:
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


_VECTORS = ((3, 2), (8, 10), (9, 11))  # coefficients that are x and y: p2 p1, s1 s3, s2 s4


def turned(
    distortion: Distortion, linear: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Distortion, NDArray[np.float64]]:
    """Return a lens and a turn about the axis that together give a turned image.

    ``linear`` ``(2, 2)`` is ``A`` of the turned image's pixels ``A D(x) + c``, of positive
    determinant, where ``D`` is the distortion. ``U`` ``(2, 2)``, upper triangular with positive
    diagonal, ``D'`` of the same model and the turn ``Q`` ``(2, 2)`` are returned:
    ``A D(x) = U D'(Q x)`` for every ``x``.

    Notes
    -----
    ``A = U G`` with a rotation ``G``. Radial terms do not change when the image plane turns;
    tangential and thin prism terms are vectors that turn along (``p2, p1``; ``s1, s3``;
    ``s2, s4``). A sensor tilted by ``R = Ry(tau_y) Rx(tau_x)`` maps the plane by ``P(R) R``, where
    ``P`` depends on R's third column only. ``G P(R) R = P(G R) G R``, and ``G R = R' Q`` with
    tilts ``R'`` anew, so ``G P(R) R = P(R') R' Q``: the tilts change, and turn the camera by
    another angle than ``G``.
    """
    below = linear[1] / math.hypot(*linear[1])
    G = np.array([[below[1], -below[0]], below])
    upper = linear @ G.T
    upper[1, 0] = 0.0  # but for rounding
    coefficients = list(distortion.coefficients)
    turn = G
    if distortion.model == "tilted" and any(coefficients[12:]):
        R = sensor_rotation(*coefficients[12:])
        R[:2] = G @ R[:2]
        row = R[1, :2] / math.hypot(*R[1, :2])
        turn = np.array([[row[1], -row[0]], row])  # R' = G R Q^T has no entry in row 1, column 0
        R[:, :2] = R[:, :2] @ turn.T
        coefficients[12:] = math.atan2(R[1, 2], R[1, 1]), math.atan2(R[2, 0], R[0, 0])
    if distortion.model != "fisheye":
        for pair in _VECTORS:
            if pair[1] < len(coefficients):
                x, y = turn @ [coefficients[i] for i in pair]
                coefficients[pair[0]], coefficients[pair[1]] = x + 0.0, y + 0.0  # no -0
    return upper, Distortion(distortion.model, tuple(coefficients)), turn
