"""Triangles for lines, boxes and arrows: thin tubes, since viewers and ray casters drop lines."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.grid import VoxelGrid

Triangles = tuple[NDArray[np.float64], NDArray[np.int64]]  # vertices (V, 3), triangles (T, 3)

# A box's corners are numbered by bits: corner 0b101 is upper in x, lower in y, upper in z.
BOX_EDGES = tuple((i, i | 1 << axis) for axis in range(3) for i in range(8) if not i >> axis & 1)


def _across(directions: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Return two unit vectors ``(N, 3)`` that complete each direction to a right-handed frame."""
    helper = np.eye(3)[np.abs(directions).argmin(axis=1)]
    first = np.cross(helper, directions)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)


def tubes(
    starts: ArrayLike,
    ends: ArrayLike,
    radius: ArrayLike,
    end_radius: ArrayLike | None = None,
    sides: int = 6,
) -> Triangles:
    """Return straight tubes from ``starts`` ``(N, 3)`` to ``ends`` ``(N, 3)``, ends closed.

    Radii are float or (N,), at the end the same when None; a tube may end in a point.
    """
    first_ends, last_ends = (np.atleast_2d(np.asarray(p, np.float64)) for p in (starts, ends))
    along = last_ends - first_ends
    lengths = np.linalg.norm(along, axis=1)
    keep = lengths > 0
    bottoms, tops, along = first_ends[keep], last_ends[keep], along[keep] / lengths[keep, None]
    n = len(bottoms)
    end_radius = radius if end_radius is None else end_radius
    radii = [
        np.broadcast_to(np.asarray(r, np.float64), len(keep))[keep] for r in (radius, end_radius)
    ]
    first, second = _across(along)
    angles = 2 * np.pi * np.arange(sides) / sides
    circle = first[:, None] * np.cos(angles)[:, None] + second[:, None] * np.sin(angles)[:, None]
    rings = [
        p[:, None] + circle * r[:, None, None] for p, r in zip((bottoms, tops), radii, strict=True)
    ]
    # (N, 2 sides + 2, 3)
    vertices = np.concatenate([*rings, bottoms[:, None], tops[:, None]], axis=1)
    here = np.arange(sides)
    after = (here + 1) % sides
    bottom, top = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    triangles = np.concatenate(
        [
            np.stack([here, after, sides + here], axis=1),
            np.stack([after, sides + after, sides + here], axis=1),
            np.stack([bottom, after, here], axis=1),
            np.stack([top, sides + here, sides + after], axis=1),
        ]
    )  # (4 sides, 3)
    offsets = np.arange(n) * (2 * sides + 2)
    return vertices.reshape(-1, 3), (triangles[None] + offsets[:, None, None]).reshape(-1, 3)


def polyline(points: ArrayLike, radius: float, closed: bool = False) -> Triangles:
    """Return tubes along ``points`` ``(N, 3)``."""
    points = np.asarray(points, np.float64)
    following = np.roll(points, -1, axis=0) if closed else points[1:]
    return tubes(points[: len(following)], following, radius)


def box_corners(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """Return a box's corners ``(8, 3)``; bit ``axis`` of the row number selects lower or upper."""
    corners = np.stack([np.asarray(lower, np.float64), np.asarray(upper, np.float64)])
    return np.array([[corners[i >> axis & 1, axis] for axis in range(3)] for i in range(8)])


def box_wires(grid: VoxelGrid, radius: float) -> Triangles:
    """Return the twelve edges of the grid's box as square bars.

    Their bounds are the box's, grown by exactly ``radius``.
    """
    corners = box_corners(grid.lower, grid.upper)
    bars = [
        (box_corners(corners[i] - radius, corners[j] + radius), _BOX_TRIANGLES)
        for i, j in BOX_EDGES
    ]
    return join(bars)


def fan(middle: ArrayLike, border: ArrayLike) -> Triangles:
    """Return the triangles between ``middle`` ``(3,)`` and a closed ``border`` ``(N, 3)``."""
    corners = np.asarray(border, np.float64)
    n = len(corners)
    here = np.arange(n)
    triangles = np.stack([np.zeros(n, np.int64), 1 + here, 1 + (here + 1) % n], axis=1)
    return np.vstack([np.asarray(middle, np.float64), corners]), triangles


def join(parts: list[Triangles]) -> Triangles:
    """Return several sets of triangles as one."""
    counts = [len(vertices) for vertices, _ in parts]
    offsets = np.cumsum([0, *counts])[:-1]
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([t + o for (_, t), o in zip(parts, offsets, strict=True)]),
    )


def arrow(start: ArrayLike, end: ArrayLike, radius: float) -> Triangles:
    """Return an arrow: a tube and a cone four times as thick."""
    start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
    neck = end - (end - start) / np.linalg.norm(end - start) * 10 * radius
    return join([tubes(start, neck, radius), tubes(neck, end, 4 * radius, 0.0, sides=16)])


def _box_triangles() -> NDArray[np.int64]:
    """Return the twelve triangles of a box whose corners are numbered by bits, facing outward."""
    triangles = []
    for axis, side in itertools.product(range(3), range(2)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        base = side << axis
        loop = [base, base | 1 << u, base | 1 << u | 1 << v, base | 1 << v]
        loop = loop if side else loop[::-1]
        triangles += [[loop[0], loop[1], loop[2]], [loop[0], loop[2], loop[3]]]
    return np.array(triangles)


_BOX_TRIANGLES = _box_triangles()
