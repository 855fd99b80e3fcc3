"""The direction of every pixel's rays, from their segments alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.trace import Segments

_SHORTEST_RUN = 1e-3
"""Fraction of the longest run of midpoints. A shorter run gives no direction: single-precision
midpoints would turn it by more than a milliradian. A larger bound drops pixels at the grid's
edges."""


def ray_directions(segments: Segments) -> NDArray[np.float64]:
    """Return the unit vector from each pixel's first segment to its last: ``(pixels, 3)``.

    Segments come in the order of travel, so the vectors point away from the camera. A pixel with
    a single segment, or with segments too near one another, takes the direction of the nearest
    pixel that has one; a set without any gets zeros.
    """
    first, last = segments.ptr[:-1], np.maximum(segments.ptr[1:] - 1, segments.ptr[:-1])
    directions = np.zeros((segments.n_pixels, 3))  # (pixels, 3)
    nonempty = np.flatnonzero(np.diff(segments.ptr))
    if not len(nonempty):
        return directions
    run = segments.midpoint[last[nonempty]].astype(np.float64)
    run -= segments.midpoint[first[nonempty]]
    length = np.linalg.norm(run, axis=1)
    known = np.flatnonzero((length > _SHORTEST_RUN * length.max(initial=0.0)) & (length > 0))
    if not len(known):
        return directions
    pixel = nonempty[known]
    unit = run[known] / length[known, None]
    right = np.clip(np.searchsorted(pixel, np.arange(segments.n_pixels)), 0, len(pixel) - 1)
    left = np.maximum(right - 1, 0)
    number = np.arange(segments.n_pixels)
    nearer_left = np.abs(number - pixel[left]) < np.abs(pixel[right] - number)
    return unit[np.where(nearer_left, left, right)]
