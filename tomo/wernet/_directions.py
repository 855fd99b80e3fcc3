"""The direction of every pixel's rays, from its crossings alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.segments import Segments

_SHORTEST = 1e-3  # of the longest run of midpoints: nearer ones give no direction


def ray_directions(segments: Segments) -> NDArray[np.float64]:
    """Return the unit vector from each pixel's first crossing to its last: ``(pixels, 3)``.

    Crossings come in the order of travel, so the vectors point away from the camera. A pixel
    with a single crossing, or with crossings too near one another, takes the direction of the
    nearest pixel that has one; a set without any gets zeros.
    """
    first, last = segments.ptr[:-1], np.maximum(segments.ptr[1:] - 1, segments.ptr[:-1])
    directions = np.zeros((segments.n_pixels, 3))  # (pixels, 3)
    crossing = np.flatnonzero(np.diff(segments.ptr))
    if not len(crossing):
        return directions
    run = segments.midpoint[last[crossing]].astype(np.float64)
    run -= segments.midpoint[first[crossing]]
    length = np.linalg.norm(run, axis=1)
    known = np.flatnonzero((length > _SHORTEST * length.max(initial=0.0)) & (length > 0))
    if not len(known):
        return directions
    pixel = crossing[known]
    unit = run[known] / length[known, None]
    right = np.clip(np.searchsorted(pixel, np.arange(segments.n_pixels)), 0, len(pixel) - 1)
    left = np.maximum(right - 1, 0)
    number = np.arange(segments.n_pixels)
    nearer_left = np.abs(number - pixel[left]) < np.abs(pixel[right] - number)
    return unit[np.where(nearer_left, left, right)]
