"""OpenCV's perspective lens: radial (rational), tangential, thin prism, tilted sensor.

One function of up to 14 coefficients; shorter models leave the rest at zero. Formulas as in
OpenCV's ``calib3d`` documentation (Brown 1966; thin prism: Weng, Cohen and Herniou 1992; tilt:
Louhichi et al. 2007).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_WIDEST = math.radians(89.9)  # largest angle off the axis at which a fold is looked for
_NEAREST = 1e-8  # smallest such angle above zero, radians
_RADIAL_STEPS = 1024  # angles of the search for a fold
_DIRECTIONS = 256  # of that search, around the axis of a lens that is not symmetric
TOLERANCE = 4e-14  # of a solved image coordinate, relative to 1 + its radius
_BLOCK = 16384  # points solved at a time; more leave the processor's cache
_CLOSE = 2e-15  # relative error at which Newton's method stops


def project(coefficients: tuple[float, ...], points: NDArray) -> tuple[NDArray, NDArray]:
    """Return the plane coordinates ``(N, 2)`` of ``points`` ``(N, 3)`` and their validity."""
    plane = np.full((len(points), 2), np.nan)
    depth = points[:, 2]
    valid = np.isfinite(points).all(axis=1) & (depth > 0)
    with np.errstate(over="ignore"):
        pinhole = points[valid, :2] / depth[valid, None]
    image, inside = _distorted(_padded(coefficients), pinhole)
    valid[valid] = inside
    plane[valid] = image[inside]
    return plane, valid


def unproject(coefficients: tuple[float, ...], plane: NDArray) -> NDArray[np.float64]:
    """Return the unit directions ``(N, 3)`` seen at ``plane`` ``(N, 2)``; NaN where none is."""
    full = _padded(coefficients)
    pinhole = np.array(plane)
    if any(full[12:]):
        pinhole = _homography(np.linalg.inv(_tilt_matrix(full)), pinhole)
    if any(full[:12]):
        for start in range(0, len(pinhole), _BLOCK):
            block = slice(start, start + _BLOCK)
            pinhole[block] = _undistorted(full, pinhole[block])
    directions = np.ones((3, len(pinhole)))  # coordinates first: loops over three numbers are slow
    directions[:2] = pinhole.T
    x, y, z = directions
    return (directions / np.sqrt(x * x + z * z + y * y)).T


def _padded(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Return all 14 coefficients."""
    return tuple(coefficients) + (0.0,) * (14 - len(coefficients))


def _distorted(full: tuple[float, ...], pinhole: NDArray) -> tuple[NDArray, NDArray]:
    """Return the distorted ``(N, 2)`` of ``pinhole`` ``(N, 2)`` and whether in the domain."""
    inside = np.isfinite(pinhole).all(axis=1)
    image = pinhole
    if any(full[:12]):
        image, in_domain = _lens_in_domain(full, pinhole)
        inside &= in_domain
    if any(full[12:]):
        image = _homography(_tilt_matrix(full), image)
    return image, inside & np.isfinite(image).all(axis=1)


def lens(full: tuple[float, ...], pinhole: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return the image of an untilted lens, its Jacobian and where its denominator is positive.

    ``full`` are OpenCV's 14 coefficients, without the two tilts, ``pinhole`` ``(..., 2)`` points
    x/z, y/z. ``(..., 2)``, ``d image[i] / d pinhole[j]`` ``(..., 2, 2)``, ``(...)``.
    """
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = full[:12]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        x, y = pinhole[..., 0], pinhole[..., 1]
        q = x * x + y * y
        top = 1 + q * (k1 + q * (k2 + q * k3))
        bottom = 1 + q * (k4 + q * (k5 + q * k6))
        top_slope = k1 + q * (2 * k2 + q * 3 * k3)
        bottom_slope = k4 + q * (2 * k5 + q * 3 * k6)
        gain = top / bottom
        slope = (top_slope - gain * bottom_slope) / bottom  # d gain / d q
        image = np.stack(
            [
                x * gain + 2 * p1 * x * y + p2 * (q + 2 * x * x) + q * (s1 + s2 * q),
                y * gain + p1 * (q + 2 * y * y) + 2 * p2 * x * y + q * (s3 + s4 * q),
            ],
            axis=-1,
        )
        prism_x, prism_y = s1 + 2 * s2 * q, s3 + 2 * s4 * q
        shared = 2 * (x * y * slope + p1 * x + p2 * y)
        jacobian = np.stack(
            [
                gain + 2 * (x * x * slope + p1 * y + 3 * p2 * x + x * prism_x),
                shared + 2 * y * prism_x,
                shared + 2 * x * prism_y,
                gain + 2 * (y * y * slope + 3 * p1 * y + p2 * x + y * prism_y),
            ],
            axis=-1,
        ).reshape(*x.shape, 2, 2)
    return image, jacobian, bottom > 0


def _lens_in_domain(full: tuple[float, ...], pinhole: NDArray) -> tuple[NDArray, NDArray]:
    """Return the image ``(N, 2)`` of an untilted lens and whether ``pinhole`` is in its domain."""
    image, jacobian, pole_free = lens(full, pinhole)
    inside = pole_free & _moves_along(jacobian) & _before_fold(full, pinhole)
    return image, inside


def _is_symmetric(full: tuple[float, ...]) -> bool:
    """Return whether the untilted lens is symmetric about its axis."""
    return not any(full[2:4] + full[8:12])


def _moves_along(jacobian: NDArray) -> NDArray[np.bool_]:
    """Return whether the symmetric part of each ``(..., 2, 2)`` is positive definite, ``(...)``.

    In a convex region where it is, no two points have one image, because ``(f(p) - f(q)) . (p - q)
    > 0``. A positive determinant is not enough: it comes back beyond a turn by 180 degrees, and
    around a strong prism's fold.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        across = (jacobian[..., 0, 1] + jacobian[..., 1, 0]) / 2
        product = jacobian[..., 0, 0] * jacobian[..., 1, 1]
        return (jacobian[..., 0, 0] > 0) & (product > across * across)


def _before_fold(full: tuple[float, ...], pinhole: NDArray) -> NDArray[np.bool_]:
    """Return whether the line from the axis to each of ``pinhole`` ``(N, 2)`` has no fold."""
    limits = fold_angles(full[:12])
    with np.errstate(over="ignore"):
        angle = np.arctan(np.hypot(pinhole[:, 0], pinhole[:, 1]))
    if len(limits) == 1:
        return angle < limits[0]
    turn = np.arctan2(pinhole[:, 1], pinhole[:, 0]) / (2 * np.pi) % 1.0 * len(limits)
    return angle < np.interp(turn, np.arange(len(limits) + 1), [*limits, limits[0]])


@lru_cache(maxsize=1024)
def fold_angles(coefficients: tuple[float, ...]) -> tuple[float, ...]:
    """Return the angle off the axis of the first fold, in equally spaced directions around it.

    One angle where the lens is symmetric, else 256 from +x to +y; pi/2 where there is no fold
    within 89.9 degrees. A fold is where the Jacobian's symmetric part or the radial denominator
    stops being positive. It is bracketed on a list of angles, dense near the axis, then bisected
    to the last bit.
    """
    is_symmetric = _is_symmetric(coefficients)
    steps = _RADIAL_STEPS * (16 if is_symmetric else 1)
    turns = np.arange(1 if is_symmetric else _DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    towards = np.stack([np.cos(turns), np.sin(turns)], axis=-1)  # (directions, 2)

    def good(angles: NDArray) -> NDArray[np.bool_]:  # (directions, n) -> (directions, n)
        _, jacobian, pole_free = lens(coefficients, np.tan(angles)[..., None] * towards[:, None])
        return pole_free & _moves_along(jacobian)

    even = np.linspace(0.0, _WIDEST, steps + 1)
    angles = np.concatenate([even[:1], np.geomspace(_NEAREST, even[1], steps // 4), even[2:]])
    bad = ~good(np.broadcast_to(angles, (len(turns), len(angles))))
    if not bad.any():
        return (np.pi / 2,) * len(turns)
    first = np.where(bad.any(axis=1), bad.argmax(axis=1), len(angles) - 1)
    low, high = angles[np.maximum(first - 1, 0)], angles[first]
    for _ in range(60):
        middle = (low + high) / 2
        if ((middle == low) | (middle == high)).all():
            break
        is_good = good(middle[:, None])[:, 0]
        low, high = np.where(is_good, middle, low), np.where(is_good, high, middle)
    return tuple(np.where(bad.any(axis=1), low, np.pi / 2).tolist())


def _undistorted(full: tuple[float, ...], image: NDArray) -> NDArray[np.float64]:
    """Return the points ``(N, 2)`` inside the domain that the lens maps to ``image``, or NaN.

    Newton's method from the inverse of the radial part; of an asymmetric lens, where that fails,
    once more from the nearest of a set of points that covers the domain.
    """
    solved = np.full_like(image, np.nan)
    todo = np.flatnonzero(np.isfinite(image).all(axis=1))
    solved[todo] = _newton(full, image[todo], _radial_start(full, image[todo]))
    if not _is_symmetric(full):
        todo = todo[np.isnan(solved[todo, 0])]
        if len(todo):
            solved[todo] = _newton(full, image[todo], _nearest_start(full, image[todo]))
    return solved


def _newton(full: tuple[float, ...], target: NDArray, start: NDArray) -> NDArray[np.float64]:
    """Return the points ``(N, 2)`` mapped to ``target``, by Newton's method; NaN on failure.

    A step is halved until it stays inside the domain and reduces the error. OpenCV's fixed-point
    iteration leaves a third of a pixel in the corners of a wide lens and ignores folds.
    """
    point = start.copy()
    error = np.linalg.norm(lens(full, point)[0] - target, axis=1)
    scale = 1 + np.linalg.norm(target, axis=1)
    active = np.flatnonzero(error > _CLOSE * scale)
    for _ in range(60):
        if not len(active):
            break
        here, jacobian, _ = lens(full, point[active])
        step = _solve(jacobian, here - target[active])
        reach = 1.0
        moved = np.zeros(len(active), bool)
        for _ in range(24):
            waiting = np.flatnonzero(~moved)
            rows = active[waiting]
            trial = point[rows] - reach * step[waiting]
            trial_image, inside = _lens_in_domain(full, trial)
            with np.errstate(over="ignore", invalid="ignore"):
                trial_error = np.linalg.norm(trial_image - target[rows], axis=1)
            better = inside & (trial_error < error[rows])
            point[rows[better]] = trial[better]
            error[rows[better]] = trial_error[better]
            moved[waiting[better]] = True
            # Points within rounding that do not improve are done.
            moved[waiting[error[rows] <= TOLERANCE * scale[rows]]] = True
            reach /= 2
            if moved.all():
                break
        active = active[moved & (error[active] > _CLOSE * scale[active])]
    found = (error <= TOLERANCE * scale) & _lens_in_domain(full, point)[1]
    return np.where(found[:, None], point, np.nan)


def _radial_start(full: tuple[float, ...], image: NDArray) -> NDArray[np.float64]:
    """Return points ``(N, 2)`` inside the domain near the preimages of ``image`` ``(N, 2)``."""
    k1, k2, _, _, k3, k4, k5, k6 = full[:8]
    radial = (k1, k2, 0.0, 0.0, k3, k4, k5, k6, 0.0, 0.0, 0.0, 0.0)
    angles = np.linspace(0.0, min(fold_angles(radial)[0], _WIDEST), 4 * _RADIAL_STEPS)
    axis = np.stack([np.tan(angles), np.zeros_like(angles)], axis=-1)
    radii = np.maximum.accumulate(lens(radial, axis)[0][:, 0])
    target = np.linalg.norm(image, axis=1)
    angle = np.interp(target, radii, angles)
    point = image * (np.tan(angle) / np.where(target > 0, target, 1.0))[:, None]
    for _ in range(60):
        outside = ~_lens_in_domain(full, point)[1]
        if not outside.any():
            break
        point[outside] *= 0.9
    return point


def _nearest_start(full: tuple[float, ...], image: NDArray) -> NDArray[np.float64]:
    """Return the point of a set over the domain whose image is nearest to each of ``image``."""
    from scipy.spatial import cKDTree

    limits = np.array(fold_angles(full[:12]))[:, None]
    angles = np.minimum(limits, _WIDEST) * np.linspace(0.0, 1.0, 257)[1:-1]  # (directions, 255)
    turns = np.arange(len(limits))[:, None] * (2 * np.pi / len(limits))
    fan = np.tan(angles)[..., None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    fan = fan.reshape(-1, 2)
    fan_image, inside = _lens_in_domain(full, fan)
    _, nearest = cKDTree(fan_image[inside]).query(image)
    return fan[inside][nearest]


def _solve(jacobian: NDArray, residual: NDArray) -> NDArray[np.float64]:
    """Return the Newton steps ``(N, 2)``; the determinants are positive inside the domain."""
    (a, b), (c, d) = np.moveaxis(jacobian, 0, -1)
    x, y = residual.T
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return np.stack([d * x - b * y, a * y - c * x], axis=-1) / (a * d - b * c)[:, None]


def sensor_rotation(tau_x: float, tau_y: float) -> NDArray[np.float64]:
    """Return the rotation ``(3, 3)`` of a sensor tilted about x by tau_x, then y by tau_y."""
    cx, sx, cy, sy = (f(tau) for tau in (tau_x, tau_y) for f in (math.cos, math.sin))
    about_x = np.array([[1, 0, 0], [0, cx, sx], [0, -sx, cx]])
    about_y = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    return about_y @ about_x


def _tilt_matrix(full: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the homography ``(3, 3)`` onto the plane of a tilted sensor."""
    turned = sensor_rotation(*full[12:])
    x, y, z = turned[:, 2]
    return np.array([[z, 0, -x], [0, z, -y], [0, 0, 1]]) @ turned


def _homography(matrix: NDArray, points: NDArray) -> NDArray[np.float64]:
    """Return ``points`` ``(N, 2)`` through ``matrix``; NaN on the far side of its horizon."""
    with np.errstate(over="ignore", invalid="ignore"):
        mapped = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ matrix.T
        weight = mapped[:, 2:]
        return np.where(weight > 0, mapped[:, :2], np.nan) / np.where(weight > 0, weight, 1.0)
