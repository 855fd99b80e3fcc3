"""Points in a box, the motion of their images, and the point nearest to rays."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera_protocol import CameraLike

ALONG = 9  # points along each edge of a box that stand for all of it


def box_points(lower: ArrayLike, upper: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return ``(count³, 3)`` points evenly spread over a box, faces included; 2 gives its corners.

    z varies fastest, then y, then x.
    """
    corners = zip(np.asarray(lower).tolist(), np.asarray(upper).tolist(), strict=True)
    axes = [np.linspace(low, high, count) for low, high in corners]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def evenly_spread(total: int, count: int) -> NDArray[np.int64]:
    """Return about ``count`` indices below ``total``, evenly spread, both ends included."""
    return np.unique(np.linspace(0, total - 1, min(count, total)).round().astype(int))


def image_motion(
    camera: CameraLike, points: NDArray[np.float64], moves: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motion of points' images for small motions of the points, in pixels, ``(N, 2)``.

    ``(u(x + m) - u(x - m)) / 2``, the derivative along ``m`` ``(N, 3)`` or ``(3,)`` to second
    order; NaN where a projection is NaN.
    """
    ahead, behind = (camera.project(points + sign * moves)[0] for sign in (1, -1))
    return (ahead - behind) / 2


SILENT = 0.1
"""Voxels: lines of sight that miss by less change no voxel, however significant the miss is."""


def nearest_point(
    positions: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the point ``(3,)`` of least squared distances to lines, and its certainty.

    ``positions, directions`` ``(N, 3)``: a point on each line and unit vectors along them. Of
    several such points, that nearest to the mean position. The certainty is the smallest
    eigenvalue of the equations: 0 for parallel lines, at most ``2 N / 3``.

    Notes
    -----
    The normal equations are ``sum_i (I - d_i d_i^T) (x - p_i) = 0``, solved about the mean
    position, so that parallel lines give a point near the cameras.
    """
    middle = positions.mean(axis=0)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (N, 3, 3)
    right = (across @ (positions - middle)[:, :, None]).sum(axis=0)[:, 0]
    offset, _, _, singular_values = np.linalg.lstsq(across.sum(axis=0), right, rcond=1e-9)
    return middle + offset, float(singular_values[-1])


def point_in_view(cameras: Iterable[CameraLike]) -> NDArray[np.float64] | None:
    """Return the point nearest to all cameras' middle rays in least squares, at which a rig looks.

    None where they are parallel, or pass each other by more than a tenth of their length.
    """
    positions, sights = [], []
    for camera in cameras:
        middle = (np.array([camera.image_size], np.float64) - 1) / 2
        origins, directions = camera.rays(middle)
        if np.isfinite(directions).all():
            sights.append(directions[0])
            positions.append(origins[0])
    if not sights:
        return None
    point, certainty = nearest_point(np.array(positions), np.array(sights))
    if certainty <= 1e-6 * len(sights):
        return None
    away = point - positions  # (cameras, 3)
    along = np.sum(away * sights, axis=1, keepdims=True) * sights
    missed = np.linalg.norm(away - along, axis=1)
    length = np.linalg.norm(away, axis=1).mean()
    if missed.mean() > 0.1 * length:
        return None
    digits = 6 - math.ceil(math.log10(length)) if length > 0 else 6  # six significant ones
    return np.round(point, digits) + 0.0
