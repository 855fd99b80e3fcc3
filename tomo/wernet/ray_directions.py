"""The direction of every pixel's rays and of their cameras, from their segments alone."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from tomo.trace import Segments

_SHORTEST_RUN = 1e-3
"""Fraction of the longest run of midpoints. A shorter run gives no direction: single-precision
midpoints would turn it by more than a milliradian. A larger bound drops pixels at the grid's
edges."""

_PARALLEL = 1e-10
"""Mean squared angle between rays, radians, below which they count as parallel. Single precision
makes 1e-12 of none; a larger bound takes long lenses for parallel rays."""


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


def squared_tangents(
    point: NDArray[np.floating], direction: NDArray[np.float64], view_ptr: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return how far rays are off their camera's axis: ``(rays,)``.

    The value is the squared tangent of the angle between a ray and the line from its camera to the
    grid's centre. The camera stands where the rays of a view meet best. A view of parallel rays
    has one of them as its axis; where all views are parallel no ray is off its axis.

    Parameters
    ----------
    point : (rays, 3)
        A point on each ray, from the grid's centre.
    direction : (rays, 3)
        Unit vectors, or zeros for a ray without any.
    view_ptr : (views + 1,)
        Where each view's rays begin.
    """
    tangents = np.zeros(len(direction))
    for start, stop in itertools.pairwise(view_ptr):
        own = slice(start, stop)
        some = direction[own].any(axis=1)
        if not some.any():
            continue
        axis = _axis(point[own][some].astype(np.float64), direction[own][some])
        along = direction[own] @ axis
        tangents[own][some] = np.maximum(1 / np.maximum(along[some], 0.1) ** 2 - 1, 0)
    return tangents if tangents.max(initial=0.0) > _PARALLEL else np.zeros(len(direction))


def _axis(point: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector from where rays meet to the origin."""
    # Distances from the rays' lines are least where  sum (1 - d d^T) (x - p) = 0.
    across = np.eye(3) - direction.T @ direction / len(direction)
    foot = point - np.sum(point * direction, axis=1, keepdims=True) * direction
    mean = direction.mean(axis=0)
    mean /= np.linalg.norm(mean)
    if np.linalg.eigvalsh(across)[0] < _PARALLEL:
        return mean
    camera = np.linalg.solve(across, foot.mean(axis=0))
    distance = np.linalg.norm(camera)
    return -camera / distance if distance > 0 and camera @ mean < 0 else mean
