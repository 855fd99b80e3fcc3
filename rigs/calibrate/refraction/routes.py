"""Which faces stand between a camera and points, found by tracing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.scene.paths import Paths
from rigs.scene.surfaces import CYLINDER, PLANE, SPHERE, TRIANGLE, Glass
from rigs.scene.tracing import REFLECTED as ENDS_REFLECTED

if TYPE_CHECKING:
    from rigs.calibrate.refraction.refraction import Refraction

PASSES, HIDDEN, REFLECTED, NONE = range(4)
"""A path passes the point; hardware or a rim is before it; total reflection is; none was found."""

_ROUNDS = 4  # of tracing towards where the route before led; the second changes nothing mostly


def routes_to(
    refraction: Refraction, center: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the faces that light from ``points`` ``(N, 3)`` crosses on its way to a camera.

    The first path goes straight towards the point; the next one takes the direction in which the
    point is seen along that path's faces, until the faces remain the same. Routes ``(N, R)`` are
    numbers of faces in order from the camera, then -1; ends ``(N,)`` are `PASSES`, `HIDDEN`,
    `REFLECTED` or `NONE`. Glass of triangles is refused.
    """
    refraction.scene.check_outside(center, "a camera")
    finite = np.isfinite(points).all(axis=1)
    routes, ends = np.full((len(points), 1), -1), np.full(len(points), NONE)
    waiting, aims = np.flatnonzero(finite), points[finite] - center
    for _ in range(_ROUNDS):
        if not len(waiting):
            break
        origins = np.broadcast_to(center, aims.shape)
        found, end = _traced(refraction, origins, aims, points[waiting])
        width = max(routes.shape[1], found.shape[1])
        routes, found = widened(routes, width), widened(found, width)
        same = (routes[waiting] == found).all(axis=1) & (ends[waiting] != NONE)
        routes[waiting], ends[waiting] = found, end
        waiting = waiting[~same]
        aims = refraction.directions(center, points[waiting], routes[waiting])
        lost = ~np.isfinite(aims).all(axis=1)
        ends[waiting[lost]] = np.where(ends[waiting[lost]] == REFLECTED, REFLECTED, NONE)
        waiting, aims = waiting[~lost], aims[~lost]
    return routes, ends


def widened(routes: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """Return routes with more columns of -1."""
    return np.pad(routes, ((0, 0), (0, width - routes.shape[1])), constant_values=-1)


def _traced(
    refraction: Refraction, origins: NDArray, aims: NDArray, points: NDArray
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the faces up to the piece of each path that passes a point most closely, and ends."""
    paths = refraction.scene.paths(origins, aims)
    counts = np.diff(paths.ray_ptr)
    away = points.repeat(counts, axis=0) - paths.origins
    along = np.einsum("ij,ij->i", away, paths.directions)
    within = np.clip(along, 0, paths.lengths)
    missed = np.linalg.norm(away - within[:, None] * paths.directions, axis=1)
    missed[_in_glass(refraction, paths)] = np.inf
    number = np.arange(len(missed)) - paths.ray_ptr[:-1].repeat(counts)  # along its ray
    table = np.full((len(paths), int(counts.max())), np.inf)
    table[np.arange(len(paths)).repeat(counts), number] = missed
    before = table.argmin(axis=1)  # pieces before the one that passes the point
    last = paths.ray_ptr[:-1] + before
    routes = np.full((len(paths), max(int(before.max()), 1)), -1)
    crossed = np.flatnonzero(number < before.repeat(counts))
    ray = np.arange(len(paths)).repeat(counts)[crossed]
    routes[ray, number[crossed]] = _faces_at(refraction, paths, crossed)
    ends = np.full(len(paths), PASSES)
    stopped = along[last] > paths.lengths[last] * (1 + 1e-9)
    stopped &= last == paths.ray_ptr[1:] - 1
    ends[stopped] = np.where(paths.ends[stopped] == ENDS_REFLECTED, REFLECTED, HIDDEN)
    return routes, ends


def _in_glass(refraction: Refraction, paths: Paths) -> NDArray[np.bool_]:
    """Return which pieces are inside glass, where no target is."""
    middle = np.where(np.isfinite(paths.lengths), paths.lengths / 2, 0.0)[:, None]
    middles = paths.origins + middle * paths.directions
    inside = np.zeros(len(middles), bool)
    for solid in refraction.scene.solids:
        if isinstance(solid.material, Glass):
            inside |= solid.contains(middles)
    return inside & np.isfinite(paths.lengths)


def _faces_at(refraction: Refraction, paths: Paths, pieces: NDArray) -> NDArray[np.int64]:
    """Return the face at which each piece ends."""
    ends, solids = paths.origins[pieces + 1], paths.solids[pieces]
    found = np.full(len(pieces), -1)
    for number in np.unique(solids):
        rows = refraction.passing(number)
        if (refraction.faces["kind"][rows] == TRIANGLE).any():
            raise ValueError(
                f"scene: solid {refraction.scene.solids[number].name}: found glass or a mirror of "
                "triangles between a camera and the target, expected a window, cylinder or "
                "sphere: their faces have exact derivatives"
            )
        own = solids == number
        apart = [_distances(ends[own], refraction.faces[row]) for row in rows]
        found[own] = rows[np.argmin(apart, axis=0)]
    return found


def _distances(points: NDArray[np.float64], face: NDArray) -> NDArray[np.float64]:
    """Return the distances of points ``(N, 3)`` from an endless face."""
    away = points - face["point"]
    along = away @ face["axis"]
    if face["kind"] == PLANE:
        return np.abs(along)
    if face["kind"] == CYLINDER:
        away = away - along[:, None] * face["axis"]
    assert face["kind"] in (CYLINDER, SPHERE)
    return np.abs(np.linalg.norm(away, axis=1) - face["radius"])
