"""Compiled: rays followed from face to face.

The slow twin is in the tests (`tests.rigs.scene.twin`). Points and directions are tuples of three
floats, which stay in registers.
"""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np

from rigs.compiled import compiled
from rigs.scene.surfaces import BLOCKS, CYLINDER, FACE, PLANE, REFLECTS, TRIANGLE

OPEN, OPAQUE, REFLECTED, TRAPPED, CONTRADICTORY = range(5)
"""How a ray ends: nothing is ahead; hardware; total reflection; too many faces; unlike media."""

POINT, AXIS, ACROSS, UPWARD, RADIUS, HOLE, HALF, INDEX, EXTINCTION, REFLECTIVITY = (
    0, 3, 6, 9, 12, 13, 14, 16, 18, 20,
)  # fmt: skip
"""First columns of a face's numbers: one array passes faster into a function than many do."""

Rays = namedtuple(
    "Rays",
    (
        "origin",  # (N, 3)
        "direction",  # (N, 3)
        "index",  # (N,) of the medium that the ray is in
        "extinction",  # (N,) of it
        "weight",  # (N,) fraction of light that passes to the camera
        "last",  # (N,) int64: the face that the ray comes from, -1 for none
        "asked",  # (N,) bool: whether meshes were asked for what is ahead
        "face",  # (N,) int64: the face ahead
        "length",  # (N,) to it
        "normal",  # (N, 3) of a triangle ahead
        "met",  # (N,) int64: faces so far
        "pieces",  # (N,) int64: pieces written so far
        "end",  # (N,) int64
    ),
)
"""Rays under way."""

Pieces = namedtuple("Pieces", ("origins", "directions", "lengths", "weight", "solids"))
"""Straight pieces, the columns of `rigs.scene.Paths`."""

_ALONG = 1e-14
"""Cosine below which a ray is parallel to a plane: its distance would be rounding alone."""


def numbers_of(table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a table of faces as two plain ones: ``(F, 3)`` int64 and ``(F, 21)`` float64.

    Those are kind, action and solid, these the others in the order of `POINT` and its neighbours.
    """
    assert FACE.names is not None  # a structured type
    whole, real = FACE.names[:3], FACE.names[3:]
    kinds = np.stack([table[name] for name in whole], axis=1)
    return kinds, np.column_stack([table[name] for name in real])


@compiled
def follow(
    active, rays, pieces, kinds, faces, boxes, region, most, fresnel, waiting
) -> int:  # fmt: skip
    """Follow rays from face to face; return how many wait for an answer of the meshes.

    ``active`` (K,) are the rays to follow, ``pieces`` (rows, N) takes theirs one behind the
    other, ``boxes`` (B, 2, 3) are those round meshes and gas, ``region`` (2, 3) that whose pieces
    are wanted; at ``most`` faces a ray is left. ``waiting`` (K,) takes rays whose piece may meet
    a mesh or gas: before they go on, ``length``, ``face`` and a triangle's ``normal`` are to be
    brought up to date, and ``asked`` set.
    """
    count = 0
    for n in active:
        origin, direction = _vector(rays.origin, n), _vector(rays.direction, n)
        normal, length, face = _vector(rays.normal, n), rays.length[n], rays.face[n]
        index, extinction = rays.index[n], rays.extinction[n]
        weight, last, asked = rays.weight[n], rays.last[n], rays.asked[n]
        met, written, end = rays.met[n], rays.pieces[n], OPEN
        while end == OPEN:
            if not asked:
                length, face = _nearest(origin, direction, last, kinds, faces)
                for b in range(len(boxes)):
                    asked = asked or _passes(origin, direction, length, boxes[b])
                if asked:
                    waiting[count] = n
                    count += 1
                    break
            asked = False
            if _passes(origin, direction, length, region):
                for a in range(3):
                    pieces.origins[written, n, a] = origin[a]
                    pieces.directions[written, n, a] = direction[a]
                pieces.lengths[written, n], pieces.weight[written, n] = length, weight
                pieces.solids[written, n] = kinds[face, 2] if length < math.inf else -1
                written += 1
            if length == math.inf:
                break
            met += 1
            weight *= math.exp(-extinction * length)
            origin = _along(origin, length, direction)
            if kinds[face, 0] != TRIANGLE:
                normal = _normal(origin, kinds[face, 0], faces, face)
            toward = _dot(direction, normal)
            front = 0 if toward < 0 else 1  # the side that the ray comes from
            action, last = kinds[face, 1], face
            if action == BLOCKS or (action == REFLECTS and front == 1):
                end = OPAQUE
            elif action == REFLECTS:
                weight *= faces[face, REFLECTIVITY]
                direction = _along(direction, -2 * toward, normal)
            elif index != faces[face, INDEX + front]:
                end = CONTRADICTORY
            else:
                after = faces[face, INDEX + 1 - front]
                direction, passed = _refracted(direction, normal, toward, index, after)
                if passed < 0:
                    end = REFLECTED
                elif fresnel:
                    weight *= passed
                index, extinction = after, faces[face, EXTINCTION + 1 - front]
            if end == OPEN and met == most:
                end = TRAPPED
        for a in range(3):
            rays.origin[n, a], rays.direction[n, a] = origin[a], direction[a]
        rays.index[n], rays.extinction[n], rays.weight[n] = index, extinction, weight
        rays.last[n], rays.face[n], rays.length[n] = last, face, length
        rays.met[n], rays.pieces[n], rays.end[n] = met, written, end
    return count


@compiled
def _vector(array, n):
    """Return a row of an array ``(N, 3)``."""
    return array[n, 0], array[n, 1], array[n, 2]


@compiled
def _three(faces, f, first):
    """Return three numbers of a face, from column ``first`` on."""
    return faces[f, first], faces[f, first + 1], faces[f, first + 2]


@compiled
def _dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def _along(start, length, direction):
    """Return the point so far along a line."""
    x, y, z = direction
    return start[0] + length * x, start[1] + length * y, start[2] + length * z


@compiled
def _nearest(origin, direction, last, kinds, faces):
    """Return the distance to the nearest face ahead, infinity if there is none, and the face."""
    length, face = math.inf, -1
    for f in range(len(faces)):
        kind = kinds[f, 0]
        if kind == TRIANGLE or (kind == PLANE and f == last):
            continue
        away = _along(origin, -1.0, _three(faces, f, POINT))
        if kind == PLANE:
            t = _to_plane(away, direction, faces, f)
        else:
            t = _to_round(away, direction, kind, faces, f, f == last)
        if t < length:
            length, face = t, f
    return length, face


@compiled
def _to_round(away, direction, kind, faces, f, leaves):
    """Return the distance to a cylinder or a sphere, infinity where the ray does not meet it.

    ``away`` is from the face's point; a ray that ``leaves`` the face meets its other side alone.
    """
    along = slope = 0.0
    across, ahead = away, direction
    if kind == CYLINDER:  # what is across the axis remains
        axis = _three(faces, f, AXIS)
        along, slope = _dot(away, axis), _dot(direction, axis)
        across, ahead = _along(away, -along, axis), _along(direction, -slope, axis)
    square = _dot(ahead, ahead)
    if square < _ALONG * _ALONG:
        return math.inf
    # from the point nearest to the axis on: far origins cost no digits
    middle = -_dot(across, ahead) / square
    across = _along(across, middle, ahead)
    depth = faces[f, RADIUS] * faces[f, RADIUS] - _dot(across, across)
    if not depth > 0:
        return math.inf
    half = math.sqrt(depth / square)
    for side in range(2):
        t = middle - half if side == 0 else middle + half
        if leaves and (side == 0) == (middle > 0):  # the root at the origin: rounding alone
            continue
        if t > 0 and abs(along + t * slope) <= faces[f, HALF]:
            return t
    return math.inf


@compiled
def _to_plane(away, direction, faces, f):
    """Return the distance to a plane face, infinity where the ray does not meet it."""
    axis = _three(faces, f, AXIS)
    toward = _dot(direction, axis)
    if abs(toward) < _ALONG:
        return math.inf
    t = -_dot(away, axis) / toward
    if not t > 0:
        return math.inf
    at = _along(away, t, direction)
    out = math.sqrt(_dot(at, at))
    if out > faces[f, RADIUS] or out < faces[f, HOLE]:
        return math.inf
    if faces[f, HALF] < math.inf or faces[f, HALF + 1] < math.inf:
        u, v = _dot(at, _three(faces, f, ACROSS)), _dot(at, _three(faces, f, UPWARD))
        if abs(u) > faces[f, HALF] or abs(v) > faces[f, HALF + 1]:
            return math.inf
    return t


@compiled
def _passes(origin, direction, length, box):
    """Return whether a piece passes a box ``(2, 3)``."""
    return into_box(origin, direction, length, box) < math.inf


@compiled
def into_box(origin, direction, length, box) -> float:
    """Return how far ahead a ray enters a box ``(2, 3)``, infinity where not within ``length``."""
    near, far = 0.0, length
    for a in range(3):
        if direction[a] == 0:
            if not box[0, a] <= origin[a] <= box[1, a]:
                return math.inf
            continue
        low = (box[0, a] - origin[a]) / direction[a]
        high = (box[1, a] - origin[a]) / direction[a]
        near, far = max(near, min(low, high)), min(far, max(low, high))
    return near if near <= far else math.inf


@compiled
def _normal(point, kind, faces, f):
    """Return the unit normal of a face at a point on it."""
    if kind == PLANE:
        return _three(faces, f, AXIS)
    out = _along(point, -1.0, _three(faces, f, POINT))
    if kind == CYLINDER:
        axis = _three(faces, f, AXIS)
        out = _along(out, -_dot(out, axis), axis)
    return _unit(out)


@compiled
def _unit(vector):
    """Return the vector at length one."""
    return _along((0.0, 0.0, 0.0), 1 / math.sqrt(_dot(vector, vector)), vector)


@compiled
def _refracted(direction, normal, toward, before, after):
    """Return the direction behind glass and the fraction that passes, -1 for total reflection.

    Snell's law in vector form, n the normal against the ray, c the cosine of incidence and e the
    ratio of indices: ``d' = e d + (e c - sqrt(1 - e² (1 - c²))) n`` (Glassner, "An Introduction
    to Ray Tracing", 1989, chapter 5). The fraction that passes is Fresnel's for unpolarised light.
    """
    ratio, cosine = before / after, abs(toward)
    rest = 1 - ratio * ratio * (1 - cosine * cosine)
    if rest < 0:
        return direction, -1.0
    inside = math.sqrt(rest)
    step = inside - ratio * cosine if toward > 0 else ratio * cosine - inside
    bent = _along(_along((0.0, 0.0, 0.0), ratio, direction), step, normal)
    across = (before * cosine - after * inside) / (before * cosine + after * inside)
    within = (after * cosine - before * inside) / (after * cosine + before * inside)
    return _unit(bent), 1 - (across * across + within * within) / 2


@compiled
def write_pieces(counts, first, pieces, columns) -> None:
    """Write the pieces ``(most, N)`` of each ray one behind the other into columns ``(total,)``.

    ``first`` (N,) says where each ray's begin.
    """
    for n in range(len(counts)):
        for k in range(counts[n]):
            at = first[n] + k
            for a in range(3):
                columns.origins[at, a] = pieces.origins[k, n, a]
                columns.directions[at, a] = pieces.directions[k, n, a]
            columns.lengths[at], columns.weight[at] = pieces.lengths[k, n], pieces.weight[k, n]
            columns.solids[at] = pieces.solids[k, n]
