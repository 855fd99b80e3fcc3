"""Where a rig looks: for the message that a volume is out of view."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, nearest_point


def point_in_view(rig: Rig) -> NDArray[np.float64] | None:
    """Return the point nearest to all cameras' middle rays, in least squares: where a rig looks.

    None where they are parallel, or pass each other by more than a tenth of their length.
    """
    positions, sights = [], []
    for camera in rig:
        middle = (np.array([camera.image_size], np.float64) - 1) / 2
        origins, directions = camera.rays(middle)
        if np.isfinite(directions).all():
            sights.append(directions[0])
            positions.append(origins[0])
    if not sights:
        return None
    sights = np.array(sights)  # (cameras, 3)
    point, certainty = nearest_point(np.array(positions), sights)
    if certainty <= 1e-6 * len(rig):
        return None
    away = point - positions  # (cameras, 3)
    along = np.sum(away * sights, axis=1, keepdims=True) * sights
    missed = np.linalg.norm(away - along, axis=1)
    length = np.linalg.norm(away, axis=1).mean()
    if missed.mean() > 0.1 * length:
        return None
    digits = 6 - math.ceil(math.log10(length)) if length > 0 else 6  # no more than it is worth
    return np.round(point, digits) + 0.0
