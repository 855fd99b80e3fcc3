"""The largest angular gap between a point's viewing directions, found exactly."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

_POINTS_AT_ONCE = 256  # more need more memory
_LATTICE = 400  # start normals over the half sphere; fewer may miss the largest cell
_PAIRS = 200  # further start normals, each between two viewing lines
_STARTS = 4  # best start normals, each followed to the maximum of its cell
_NEAREST = 5  # nearest viewing planes tried as the bounds of a cell
_ITERATIONS = 4  # of that search; it converges after one or two


def largest_gap(
    directions: NDArray[np.float64], seen: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the largest angular gap between viewing lines, and where it is.

    Parameters
    ----------
    directions : (N, C, 3) float64
        Unit vectors between each of N points and C cameras; the sign does not matter.
    seen : (N, C) bool, optional
        Which cameras see the point; all when None.

    Returns
    -------
    gap : (N,) float64
        Degrees, from 0 to 180. A single view, or none, leaves 180.
    normal : (N, 3) float64
        Unit vector at the middle of the missing wedge of spatial frequencies; NaN where no camera
        sees the point.

    Notes
    -----
    An emission's line integral is the same from both ends: directions count modulo 180 degrees.
    By the central-slice theorem the view along ``d`` measures the spatial frequencies in the
    plane across ``d``; a frequency along the unit vector ``n`` is ``asin |n . d|`` away from it.
    The gap is twice the largest distance of any frequency from the measured ones,

        gap = 2 max_n min_i asin |n . d_i| ,

    zero exactly where Orlov's condition holds (S. S. Orlov, Sov. Phys. Crystallogr. 20, 312,
    1975: the directions meet every great circle). Where all directions lie in one plane it is the
    largest angle between neighbours modulo 180 degrees: 180 / n for n evenly spread views.

    The planes across the viewing lines divide the sphere of normals into cells. The best normal of
    a cell touches one, two or three planes. Normals that touch the nearest few planes are tried,
    from starts all over the sphere, until none improves.
    """
    directions = np.asarray(directions, np.float64)
    if directions.ndim != 3 or directions.shape[2] != 3:
        raise ValueError(f"directions: found shape {directions.shape}, expected (N, C, 3)")
    seen = np.ones(directions.shape[:2], bool) if seen is None else np.asarray(seen, bool)
    gap = np.full(len(directions), 180.0)
    normal = np.full((len(directions), 3), np.nan)
    some = np.flatnonzero(seen.any(axis=1))
    starts = _starts(directions[some], seen[some]) if some.size else None
    for first in range(0, len(some), _POINTS_AT_ONCE):
        now = some[first : first + _POINTS_AT_ONCE]
        sines, normal[now] = _search(directions[now], seen[now], starts)
        gap[now] = 2 * np.degrees(np.arcsin(np.clip(sines, 0, 1)))
    return gap, normal


def new_view(
    normal: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the viewing direction ``(3,)`` that best closes a gap, as a unit vector.

    Every direction across ``normal`` ``(3,)`` closes the gap. The one returned is closest to the
    present ``directions`` ``(C, 3)``: for a ring it lies in the ring's plane. None where the
    directions do not determine one.
    """
    across = directions - (directions @ normal)[:, None] * normal
    values, vectors = np.linalg.eigh(across.T @ across)
    return vectors[:, -1] if values[-1] > 1e-12 else None


def lines_of_sight(
    directions: NDArray[np.float64], seen: NDArray[np.bool_], apart: float
) -> NDArray[np.int64]:
    """Return the number of different lines along which each point is seen, ``(N,)``.

    Parameters
    ----------
    directions : (N, C, 3) float64
        Unit vectors between each of N points and C cameras; the sign does not matter.
    seen : (N, C) bool
        Which cameras see the point.
    apart : float
        Degrees; lines closer than that count as one.
    """
    counts = np.zeros(len(seen), np.int64)
    for point, (lines, sees) in enumerate(zip(directions, seen, strict=True)):
        same = angles_between(lines[sees]) < apart
        own: list[int] = []
        for view in range(len(same)):
            if not same[view, own].any():
                own.append(view)
        counts[point] = len(own)
    return counts


def angles_between(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles in degrees, 0 to 90, between lines along ``(C, 3)``: ``(C, C)``.

    The diagonal is infinite, so that a row's minimum is the nearest other line.
    """
    lines = lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-300)
    # by sine and cosine: the arc cosine alone is inexact for nearly equal lines
    sine = np.linalg.norm(np.cross(lines[:, None], lines[None]), axis=2)
    angles = np.degrees(np.arctan2(sine, np.abs(lines @ lines.T)))
    np.fill_diagonal(angles, np.inf)
    return angles


def _starts(directions: NDArray, seen: NDArray) -> NDArray[np.float64]:
    """Return normals to start from, ``(S, 3)``: a lattice, and the best between two lines."""
    index = np.arange(_LATTICE) + 0.5
    height, angle = index / _LATTICE, np.pi * (1 + 5**0.5) * index
    level = np.sqrt(1 - height**2)
    lattice = np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=-1)
    lines = directions[np.argmax(seen.sum(axis=1))]  # from a point that most cameras see
    one, other = np.triu_indices(len(lines), 1)
    pairs = np.concatenate([lines, lines[one] + lines[other], lines[one] - lines[other]])
    length = np.linalg.norm(pairs, axis=1)
    pairs = pairs[length > 1e-9] / length[length > 1e-9, None]
    best = np.argsort(-np.abs(pairs @ lines.T).min(axis=1), kind="stable")[:_PAIRS]
    return np.concatenate([lattice, pairs[best]])


def _search(directions: NDArray, seen: NDArray, starts: NDArray) -> tuple[NDArray, NDArray]:
    """Return the largest ``min_i |n . d_i|`` ``(N,)`` and its normals ``(N, 3)``."""
    found = _nearest(starts[None], directions, seen)  # (N, S)
    best = np.argsort(-found, axis=1, kind="stable")[:, :_STARTS]
    normals = starts[best]  # (N, starts, 3)
    values = np.take_along_axis(found, best, axis=1)
    for _ in range(_ITERATIONS):
        tried = _touching(normals, directions, seen)  # (N, starts, tries, 3)
        count = tried.shape[2]
        reached = _nearest(tried.reshape(len(tried), -1, 3), directions, seen)
        reached = reached.reshape(len(tried), -1, count)
        top = reached.argmax(axis=2)
        better = np.take_along_axis(reached, top[..., None], axis=2)[..., 0]
        moved = np.take_along_axis(tried, top[..., None, None], axis=2)[:, :, 0]
        improves = better > values + 1e-12
        if not improves.any():
            break
        normals = np.where(improves[..., None], moved, normals)
        values = np.where(improves, better, values)
    top = values.argmax(axis=1)
    rows = np.arange(len(values))
    return values[rows, top], normals[rows, top]


def _nearest(normals: NDArray, directions: NDArray, seen: NDArray) -> NDArray[np.float64]:
    """Return ``min_i |n . d_i|`` over the views that see, ``(N, S)`` of ``normals (., S, 3)``."""
    sines = np.abs(normals @ directions.transpose(0, 2, 1))  # (N, S, C)
    return np.where(seen[:, None], sines, 2.0).min(axis=2)


def _touching(normals: NDArray, directions: NDArray, seen: NDArray) -> NDArray[np.float64]:
    """Return normals as far as possible from one, two or three of the nearest planes."""
    sines = normals @ directions.transpose(0, 2, 1)  # (N, S, C)
    near = np.where(seen[:, None], np.abs(sines), 2.0)
    order = np.argsort(near, axis=2, kind="stable")[..., :_NEAREST]
    rows = np.arange(len(directions))[:, None, None]
    signs = np.where(np.take_along_axis(sines, order, axis=2) < 0, -1.0, 1.0)
    usable = seen[rows, order][..., None]
    planes = np.where(usable, signs[..., None] * directions[rows, order], 0.0)  # (N, S, k, 3)
    tried = [planes[..., i, :] for i in range(planes.shape[2])]
    for i, j in itertools.combinations(range(planes.shape[2]), 2):
        tried.append(planes[..., i, :] + planes[..., j, :])
    for i, j, k in itertools.combinations(range(planes.shape[2]), 3):
        first = planes[..., i, :] - planes[..., j, :]
        tried.append(np.cross(first, planes[..., i, :] - planes[..., k, :]))
    tried = np.stack(tried, axis=2)
    length = np.linalg.norm(tried, axis=-1, keepdims=True)
    return np.where(length > 1e-9, tried / np.maximum(length, 1e-9), normals[:, :, None])
