"""Compiled: the nearest face ahead of rays, and what the face does to them.

The slow twin is in the tests (`tests.rigs.scene.twin`).
"""

from __future__ import annotations

import math

from rigs.compiled import compiled
from rigs.scene.surfaces import BLOCKS, CYLINDER, PLANE, REFLECTS, TRIANGLE

OPEN, OPAQUE, REFLECTED, TRAPPED, CONTRADICTORY = range(5)
"""How a ray ends: nothing is ahead; hardware; total reflection; too many faces; unlike media."""

_ALONG = 1e-14
"""Cosine below which a ray is parallel to a plane: its distance would be rounding alone."""


@compiled
def nearest_face(origins, directions, last, faces, distances, found) -> None:
    """Write the distance to the nearest face ahead of each ray, and its number.

    Parameters
    ----------
    origins, directions : (N, 3) float64
    last : (N,) int64
        The face that the ray comes from, -1 for none: it is met again at the far side alone.
    faces : (F,) FACE
    distances : (N,) float64
        Infinite on entry, or the distance of what is in the way already.
    found : (N,) int64
        Written where a face is nearer.
    """
    for n in range(len(distances)):
        for f in range(len(faces)):
            t = _distance(origins[n], directions[n], faces[f], last[n] == f)
            if t < distances[n]:
                distances[n] = t
                found[n] = f


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
def meet(
    origins, directions, lengths, normals, found, faces, media, weights, fresnel, ends
) -> None:
    """Move rays to the face that each has found, and turn them there.

    Parameters
    ----------
    origins, directions : (N, 3) float64
        Changed in place.
    lengths : (N,) float64
        To the face; infinite for a ray that goes on for ever, which is left as it is.
    normals : (N, 3) float64
        Unit normals of faces that are triangles; of other faces they are found here.
    found : (N,) int64
        Number of the face in ``faces``.
    faces : (F,) FACE
    media : (N, 2) float64
        Index and extinction of the medium that the ray is in; changed in place.
    weights : (N,) float64
        Fraction of light that passes; changed in place.
    fresnel : bool
        Whether glass keeps the fraction that it reflects.
    ends : (N,) int64
        Changed in place where a ray ends.

    Notes
    -----
    Snell's law in vector form, n the normal against the ray, c the cosine of incidence and e the
    ratio of indices: ``d' = e d + (e c - sqrt(1 - e² (1 - c²))) n`` (Glassner, "An Introduction
    to Ray Tracing", 1989, chapter 5). The fraction that passes is Fresnel's for unpolarised light.
    """
    for i in range(len(lengths)):
        if ends[i] != OPEN or not lengths[i] < math.inf:
            continue
        weights[i] *= math.exp(-media[i, 1] * lengths[i])
        for a in range(3):
            origins[i, a] += lengths[i] * directions[i, a]
        face = faces[found[i]]
        if face.kind != TRIANGLE:
            _normal(origins[i], face, normals[i])
        toward = 0.0
        for a in range(3):
            toward += directions[i, a] * normals[i, a]
        front = 0 if toward < 0 else 1  # the side that the ray comes from
        if face.action == BLOCKS or (face.action == REFLECTS and front == 1):
            ends[i] = OPAQUE
        elif face.action == REFLECTS:
            weights[i] *= face.reflectivity
            for a in range(3):
                directions[i, a] -= 2 * toward * normals[i, a]
        elif media[i, 0] != face.index[front]:
            ends[i] = CONTRADICTORY
        else:
            passed = _refract(
                directions[i], normals[i], toward, face.index[front], face.index[1 - front]
            )
            if passed < 0:
                ends[i] = REFLECTED
            else:
                weights[i] *= passed if fresnel else 1.0
                media[i, 0], media[i, 1] = face.index[1 - front], face.extinction[1 - front]


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
