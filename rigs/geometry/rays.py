"""Rays of several cameras: the point nearest to all, and where a rig looks."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from rigs.camera_protocol import CameraLike

SILENT = 0.1
"""Voxels: lines of sight that miss by less change no voxel, however significant the miss is."""


def nearest_point(
    positions: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the point with the least sum of squared distances to lines.

    The normal equations are ``sum_i (I - d_i d_i^T) (x - p_i) = 0``, solved about the mean
    position, so that parallel lines give a point near the cameras.

    Parameters
    ----------
    positions : (N, 3) float64
        A point on each line.
    directions : (N, 3) float64
        Unit vectors along them.

    Returns
    -------
    point : (3,) float64
        The one nearest to the mean position where it is not unique.
    certainty : float
        The smallest eigenvalue of the equations: 0 for parallel lines, at most ``2 N / 3``.
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
