"""Compiled: the nearest face ahead of rays, and what the face does to them.

The slow twin is in the tests (`tests.rigs.scene.twin`).
"""

from __future__ import annotations

import math

import numpy as np

from rigs.compiled import compiled
from rigs.scene.surfaces import BLOCKS, CYLINDER, PLANE, REFLECTS, TRIANGLE

OPEN, OPAQUE, REFLECTED, TRAPPED, CONTRADICTORY = range(5)
"""How a ray ends: nothing is ahead; hardware; total reflection; too many faces; unlike media."""

RAY = np.dtype(
    [
        ("origin", np.float64, (3,)),
        ("direction", np.float64, (3,)),
        ("index", np.float64),  # of the medium that the ray is in
        ("extinction", np.float64),
        ("weight", np.float64),  # fraction of light that passes to the camera
        ("last", np.int64),  # the face that the ray comes from, -1 for none
        ("face", np.int64),  # the face ahead
        ("length", np.float64),  # to the face ahead
        ("normal", np.float64, (3,)),  # of the face ahead
        ("asked", np.bool_),  # whether meshes were asked for the face ahead
        ("pieces", np.int64),
        ("end", np.int64),
    ]
)
"""A ray under way."""

PIECE = np.dtype(
    [
        ("origin", np.float64, (3,)),
        ("direction", np.float64, (3,)),
        ("length", np.float64),
        ("weight", np.float64),
        ("solid", np.int64),
    ]
)
"""A straight piece of a path, as in `rigs.scene.Paths`."""

_ALONG = 1e-14
"""Cosine below which a ray is parallel to a plane: its distance would be rounding alone."""


@compiled
def follow(active, rays, pieces, faces, boxes, fresnel, waiting) -> int:
    """Follow rays from face to face; return how many wait for an answer of the meshes.

    Parameters
    ----------
    active : (K,) int64
        The rays to follow.
    rays : (N,) RAY
        Where they are; changed in place.
    pieces : (most, N) PIECE
        Written: the pieces of each ray, which is left when it has ``most``.
    faces : (F,) FACE
    boxes : (meshes, 2, 3) float64
        Lower and upper corners of the boxes round meshes.
    fresnel : bool
        Whether glass keeps the fraction of light that it reflects.
    waiting : (K,) int64
        Written: rays whose piece may meet a mesh. Their ``length``, ``face`` and, of a triangle,
        ``normal`` are to be brought up to date, and ``asked`` set, before they are followed on.
    """
    count = 0
    for n in active:
        ray = rays[n]
        while ray.end == OPEN:
            if not ray.asked:
                _find_face(ray, faces)
                if _may_meet(ray, boxes):
                    waiting[count] = n
                    count += 1
                    break
            ray.asked = False
            piece = pieces[ray.pieces, n]
            ahead = ray.length < math.inf
            for a in range(3):
                piece.origin[a], piece.direction[a] = ray.origin[a], ray.direction[a]
            piece.length, piece.weight = ray.length, ray.weight
            piece.solid = faces[ray.face].solid if ahead else -1
            ray.pieces += 1
            if not ahead:
                break
            _meet(ray, faces[ray.face], fresnel)
            if ray.end == OPEN and ray.pieces == len(pieces):
                ray.end = TRAPPED
    return count


@compiled
def _find_face(ray, faces) -> None:
    """Set a ray's length and face to those of the nearest face ahead."""
    ray.length = math.inf
    for f in range(len(faces)):
        t = _distance(ray.origin, ray.direction, faces[f], ray.last == f)
        if t < ray.length:
            ray.length, ray.face = t, f


@compiled
def _may_meet(ray, boxes):
    """Return whether a ray's piece passes the box of a mesh."""
    for box in boxes:
        if into_box(ray.origin, ray.direction, box[0], box[1], ray.length) < math.inf:
            return True
    return False


@compiled
def into_box(origin, direction, lower, upper, length) -> float:
    """Return how far ahead a ray enters a box, infinity where not within ``length``."""
    near, far = 0.0, length
    for a in range(3):
        if direction[a] == 0:
            if not lower[a] <= origin[a] <= upper[a]:
                return math.inf
            continue
        low, high = (lower[a] - origin[a]) / direction[a], (upper[a] - origin[a]) / direction[a]
        near, far = max(near, min(low, high)), min(far, max(low, high))
    return near if near <= far else math.inf


@compiled
def write_pieces(rays, pieces, first, columns) -> None:
    """Write rays' pieces one behind the other, from ``first`` (N,) on, into columns.

    ``columns`` are those of `rigs.scene.Paths`: origins, directions, lengths, weight, solids.
    """
    origins, directions, lengths, weight, solids = columns
    for n in range(len(rays)):
        for k in range(rays[n].pieces):
            piece, at = pieces[k, n], first[n] + k
            for a in range(3):
                origins[at, a], directions[at, a] = piece.origin[a], piece.direction[a]
            lengths[at], weight[at], solids[at] = piece.length, piece.weight, piece.solid


@compiled
def _distance(origin, direction, face, leaves):
    """Return the distance to a face, infinity where the ray does not meet it."""
    if face.kind == TRIANGLE:
        return math.inf
    if face.kind == PLANE:
        return math.inf if leaves else _to_plane(origin, direction, face)
    wx, wy, wz = origin[0] - face.point[0], origin[1] - face.point[1], origin[2] - face.point[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    along = slope = 0.0
    if face.kind == CYLINDER:  # what is across the axis remains
        ax, ay, az = face.axis[0], face.axis[1], face.axis[2]
        along = wx * ax + wy * ay + wz * az
        slope = dx * ax + dy * ay + dz * az
        wx, wy, wz = wx - along * ax, wy - along * ay, wz - along * az
        dx, dy, dz = dx - slope * ax, dy - slope * ay, dz - slope * az
    square = dx * dx + dy * dy + dz * dz
    if square < _ALONG * _ALONG:
        return math.inf
    # from the point nearest to the axis on: far origins cost no digits
    middle = -(wx * dx + wy * dy + wz * dz) / square
    wx, wy, wz = wx + middle * dx, wy + middle * dy, wz + middle * dz
    depth = face.radius * face.radius - (wx * wx + wy * wy + wz * wz)
    if not depth > 0:
        return math.inf
    half = math.sqrt(depth / square)
    for side in range(2):
        t = middle - half if side == 0 else middle + half
        if leaves and (side == 0) == (middle > 0):  # the root at the origin: rounding alone
            continue
        if t > 0 and abs(along + t * slope) <= face.half[0]:
            return t
    return math.inf


@compiled
def _to_plane(origin, direction, face):
    """Return the distance to a plane face, infinity where the ray does not meet it."""
    toward = height = 0.0
    for a in range(3):
        toward += direction[a] * face.axis[a]
        height += (face.point[a] - origin[a]) * face.axis[a]
    if abs(toward) < _ALONG:
        return math.inf
    t = height / toward
    if not t > 0:
        return math.inf
    u = v = square = 0.0
    for a in range(3):
        at = origin[a] + t * direction[a] - face.point[a]
        b, c = (a + 1) % 3, (a + 2) % 3
        other = face.axis[b] * face.across[c] - face.axis[c] * face.across[b]
        u += at * face.across[a]
        v += at * other
        square += at * at
    if abs(u) > face.half[0] or abs(v) > face.half[1]:
        return math.inf
    out = math.sqrt(square)
    return math.inf if out > face.radius or out < face.hole else t


@compiled
def _meet(ray, face, fresnel) -> None:
    """Move a ray to the face ahead and turn it there.

    Notes
    -----
    Snell's law in vector form, n the normal against the ray, c the cosine of incidence and e the
    ratio of indices: ``d' = e d + (e c - sqrt(1 - e² (1 - c²))) n`` (Glassner, "An Introduction
    to Ray Tracing", 1989, chapter 5). The fraction that passes is Fresnel's for unpolarised light.
    """
    if ray.extinction > 0:
        ray.weight *= math.exp(-ray.extinction * ray.length)
    for a in range(3):
        ray.origin[a] += ray.length * ray.direction[a]
    if face.kind != TRIANGLE:
        _normal(ray.origin, face, ray.normal)
    toward = 0.0
    for a in range(3):
        toward += ray.direction[a] * ray.normal[a]
    ray.last = ray.face
    front = 0 if toward < 0 else 1  # the side that the ray comes from
    if face.action == BLOCKS or (face.action == REFLECTS and front == 1):
        ray.end = OPAQUE
    elif face.action == REFLECTS:
        ray.weight *= face.reflectivity
        for a in range(3):
            ray.direction[a] -= 2 * toward * ray.normal[a]
    elif ray.index != face.index[front]:
        ray.end = CONTRADICTORY
    else:
        after = face.index[1 - front]
        passed = _refract(ray.direction, ray.normal, toward, ray.index, after)
        if passed < 0:
            ray.end = REFLECTED
        else:
            ray.weight *= passed if fresnel else 1.0
            ray.index, ray.extinction = after, face.extinction[1 - front]


@compiled
def _normal(point, face, normal) -> None:
    """Write the unit normal of a face at a point on it."""
    along = 0.0
    for a in range(3):
        along += (point[a] - face.point[a]) * face.axis[a]
    square = 0.0
    for a in range(3):
        if face.kind == PLANE:
            normal[a] = face.axis[a]
        else:
            axial = along * face.axis[a] if face.kind == CYLINDER else 0.0
            normal[a] = point[a] - face.point[a] - axial
        square += normal[a] * normal[a]
    for a in range(3):
        normal[a] /= math.sqrt(square)


@compiled
def _refract(direction, normal, toward, before, after):
    """Turn a direction at glass; return the fraction that passes, -1 for total reflection."""
    ratio = before / after
    cosine = abs(toward)
    rest = 1 - ratio * ratio * (1 - cosine * cosine)
    if rest < 0:
        return -1.0
    inside = math.sqrt(rest)
    step = (inside - ratio * cosine) if toward > 0 else (ratio * cosine - inside)
    square = 0.0
    for a in range(3):
        direction[a] = ratio * direction[a] + step * normal[a]
        square += direction[a] * direction[a]
    for a in range(3):
        direction[a] /= math.sqrt(square)
    across = (before * cosine - after * inside) / (before * cosine + after * inside)
    within = (after * cosine - before * inside) / (after * cosine + before * inside)
    return 1 - (across * across + within * within) / 2
