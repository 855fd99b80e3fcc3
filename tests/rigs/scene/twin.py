"""The slow twin of `rigs.scene.tracing`: one ray at a time, by angles and polynomial roots."""

import math

import numpy as np

from rigs.scene.surfaces import BLOCKS, CYLINDER, PLANE, REFLECTS
from rigs.scene.tracing import CONTRADICTORY, OPAQUE, OPEN, REFLECTED


def slow_path(faces, medium, origin, direction, *, near=1e-9):
    """Return origins, directions, lengths and weights of a ray's pieces, and how it ends."""
    origin, direction = np.array(origin, float), np.array(direction, float)
    index, extinction, weight, pieces = medium, 0.0, 1.0, []
    while True:
        hits = [
            (t, face) for face in faces for t in _crossings(origin, direction, face) if t > near
        ]
        if not hits:
            return [*pieces, (origin, direction, math.inf, weight)], OPEN
        length, face = min(hits, key=lambda hit: hit[0])
        pieces.append((origin, direction, length, weight))
        weight *= math.exp(-extinction * length)
        origin = origin + length * direction
        normal = _normal(origin, face)
        front = 0 if direction @ normal < 0 else 1
        if face["action"] == BLOCKS or (face["action"] == REFLECTS and front):
            return pieces, OPAQUE
        if face["action"] == REFLECTS:
            weight *= face["reflectivity"]
            direction = (np.eye(3) - 2 * np.outer(normal, normal)) @ direction
            continue
        before, after = face["index"][front], face["index"][1 - front]
        if before != index:
            return pieces, CONTRADICTORY
        inward = -normal if front == 0 else normal
        across = direction - (direction @ inward) * inward
        sine = np.linalg.norm(across) * before / after
        if sine > 1:
            return pieces, REFLECTED
        angle = math.asin(sine)
        if sine > 0:
            across = across / np.linalg.norm(across)
        direction = math.cos(angle) * inward + math.sin(angle) * across
        index, extinction = after, face["extinction"][1 - front]


def _crossings(origin, direction, face):
    """Return the distances at which a line meets a face, inside its outline."""
    away, axis = origin - face["point"], face["axis"]
    if face["kind"] == PLANE:
        if direction @ axis == 0:
            return []
        t = -(away @ axis) / (direction @ axis)
        at = away + t * direction
        flat = np.array([at @ face["across"], at @ np.cross(axis, face["across"])])
        out = np.linalg.norm(at)
        inside = (np.abs(flat) <= face["half"]).all() and face["hole"] <= out <= face["radius"]
        return [t] if inside else []
    turn = np.eye(3) - np.outer(axis, axis) if face["kind"] == CYLINDER else np.eye(3)
    a, d = turn @ away, turn @ direction
    roots = np.roots([d @ d, 2 * a @ d, a @ a - face["radius"] ** 2])
    along = [(away + t * direction) @ axis for t in roots.real]
    return [
        t.real
        for t, x in zip(roots, along, strict=True)
        if t.imag == 0 and (face["kind"] != CYLINDER or abs(x) <= face["half"][0])
    ]


def _normal(point, face):
    """Return the unit normal of a face at a point on it."""
    if face["kind"] == PLANE:
        return face["axis"]
    out = point - face["point"]
    if face["kind"] == CYLINDER:
        out = out - (out @ face["axis"]) * face["axis"]
    return out / np.linalg.norm(out)
