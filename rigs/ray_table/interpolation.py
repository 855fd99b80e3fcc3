"""Interpolation of a table of rays, and its inverse: the pixel whose ray passes a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

REACH = 8.0  # table pixels of extrapolation beyond the outermost centres
_NODES = 32  # start rays along each side of the image; fewer may miss a basin
DEPTHS = 16  # start points along each of them
_STARTS = 8  # start points tried where the table has holes or jumps
STEPS = 40  # of Newton's method; it takes some five
CLOSE = 1e-9  # pixels, where Newton's method stops
_GOOD = 1e-4  # pixels; a kink between two cells may keep Newton's method that far off


@dataclass(frozen=True, eq=False)
class LocalRays:
    """Rays before normalising, with derivatives by table column and row: ``(N, 3)`` each."""

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    origin_x: NDArray[np.float64]
    origin_y: NDArray[np.float64]
    direction_x: NDArray[np.float64]
    direction_y: NDArray[np.float64]


def interpolated_rays(
    origins: NDArray[np.float64], directions: NDArray[np.float64], xy: NDArray[np.float64]
) -> LocalRays:
    """Return the rays at fractional pixels ``(N, 2)`` of a table, bilinear between its pixels.

    Next to a pixel without a ray (NaN), and beyond the border, a ray is extrapolated from the
    nearest pixel by its slopes to existing neighbours. It is NaN where the nearest pixel has no
    ray.
    """
    height, width = directions.shape[:2]
    size = np.array([width, height])
    known = np.asarray(np.isfinite(xy).all(axis=1))
    known &= np.asarray(((xy >= -REACH) & (xy <= size - 1 + REACH)).all(axis=1))
    pixel = np.where(known[:, None], xy, 0.0)
    low = np.clip(np.floor(pixel), 0, np.maximum(size - 2, 0)).astype(np.int64)
    high = np.minimum(low + 1, size - 1)
    fraction = pixel - low  # beyond 0 to 1 outside the image

    def bilinear(table: NDArray[np.float64]) -> NDArray[np.float64]:
        (left, above), (right, below) = low.T, high.T
        a, b = table[above, left], table[above, right]
        c, d = table[below, left], table[below, right]
        return _bilinear(a, b, c, d, fraction)

    values = np.zeros((3, 2, len(xy), 3))  # value and slopes, of origins and directions
    values[:, 1] = bilinear(directions)
    if origins.strides[:2] == (0, 0):  # all rays share one
        values[0, 0] = origins[0, 0]
    else:
        values[:, 0] = bilinear(origins)
    broken = np.flatnonzero(known & np.isnan(values[0]).any(axis=(0, 2)))
    if len(broken):
        values[:, :, broken] = _one_sided(origins, directions, pixel[broken])
    values[:, :, ~known] = np.nan
    (origin, direction), (origin_x, direction_x), (origin_y, direction_y) = values
    return LocalRays(origin, direction, origin_x, origin_y, direction_x, direction_y)


def _bilinear(
    a: NDArray, b: NDArray, c: NDArray, d: NDArray, fraction: NDArray
) -> NDArray[np.float64]:
    """Return value and slopes ``(3, N, 3)`` between the corners of cells, a b above c d."""
    x, y = fraction[:, :1], fraction[:, 1:]
    above, below = b - a, d - c
    return np.stack(
        [
            (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d),
            (1 - y) * above + y * below,
            (1 - x) * (c - a) + x * (d - b),
        ]
    )


def _one_sided(
    origins: NDArray[np.float64], directions: NDArray[np.float64], xy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return value and slopes ``(3, 2, N, 3)`` from the nearest pixel and its neighbours."""
    size = np.array(directions.shape[1::-1])
    nearest = np.clip(np.rint(xy), 0, size - 1).astype(np.int64)
    away = xy - nearest
    tables = np.stack(np.broadcast_arrays(origins, directions))  # (2, h, w, 3)
    here = tables[:, nearest[:, 1], nearest[:, 0]]  # (2, N, 3)
    slopes = []
    for axis in (0, 1):
        towards = np.where(away[:, axis] < 0, -1, 1)
        slope = np.zeros_like(here)
        for sign in (-towards, towards):  # the neighbour on the nearer side comes last and wins
            neighbour = nearest.copy()
            neighbour[:, axis] += sign
            inside = (neighbour[:, axis] >= 0) & (neighbour[:, axis] < size[axis])
            neighbour = np.clip(neighbour, 0, size - 1)
            step = (tables[:, neighbour[:, 1], neighbour[:, 0]] - here) * sign[:, None]
            usable = inside & np.isfinite(step).all(axis=(0, 2))
            slope[:, usable] = step[:, usable]
        slopes.append(slope)
    value = here + away[:, :1] * slopes[0] + away[:, 1:] * slopes[1]
    return np.stack([value, *slopes])


def project_to_table(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    points: NDArray[np.float64],
    is_whole: bool,
) -> NDArray[np.float64]:
    """Return the table pixels ``(N, 2)`` whose rays pass through points; NaN where none does.

    Newton's method solves ``o(x, y) + s d(x, y) = p`` for column, row and distance ``s``, from the
    nearest of a set of points on the rays; once for a table without holes and jumps
    (``is_whole``).
    """
    from scipy.spatial import cKDTree

    found = np.full((len(points), 2), np.nan)
    waiting = np.flatnonzero(np.isfinite(points).all(axis=1))
    if not len(waiting):
        return found
    nodes, pixels, lengths = _nodes(origins, directions, points[waiting])
    if not len(nodes):
        return found
    starts = min(1 if is_whole else _STARTS, len(nodes))
    nearest = cKDTree(nodes).query(points[waiting], k=[*range(1, starts + 1)])[1]  # (n, starts)
    for attempt in range(starts):
        if not len(waiting):
            break
        start = nearest[:, attempt]
        xy = _newton(origins, directions, points[waiting], pixels[start], lengths[start])
        found[waiting] = xy
        failed = np.isnan(xy[:, 0])
        waiting, nearest = waiting[failed], nearest[failed]
    return found


def _nodes(
    origins: NDArray[np.float64], directions: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray, NDArray, NDArray]:
    """Return points on rays all over the table, the rays' pixels and the lengths up to them."""
    height, width = directions.shape[:2]
    rows = np.unique(np.linspace(0, height - 1, min(height, _NODES)).astype(int))
    columns = np.unique(np.linspace(0, width - 1, min(width, _NODES)).astype(int))
    y, x = (a.ravel() for a in np.meshgrid(rows, columns, indexing="ij"))
    o, d = origins[y, x], directions[y, x]
    seen = np.isfinite(d).all(axis=1)
    pixels, o, d = np.stack([x, y], axis=1)[seen].astype(np.float64), o[seen], d[seen]
    if not len(o):
        return o, pixels, np.zeros(0)
    away = np.linalg.norm(points - o.mean(axis=0), axis=1)
    spread = float(np.linalg.norm(o - o.mean(axis=0), axis=1).max())
    low, high = max(float(away.min()) - spread, 1e-3 * float(away.max())), float(away.max())
    steps = np.linspace(low, max(high + spread, low * (1 + 1e-9)), DEPTHS)
    nodes = o[:, None] + steps[:, None] * d[:, None]  # (rays, depths, 3)
    return (nodes.reshape(-1, 3), np.repeat(pixels, DEPTHS, axis=0), np.tile(steps, len(pixels)))


def _newton(
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    points: NDArray[np.float64],
    start: NDArray[np.float64],
    lengths: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the table pixels ``(N, 2)`` of rays through ``points``, from ``start``, or NaN."""
    height, width = directions.shape[:2]
    size = np.array([width, height], np.float64)
    state = np.column_stack([start, lengths])  # (N, 3): x, y, s
    last = np.full(len(points), np.inf)
    active = np.arange(len(points))
    for _ in range(STEPS):
        rays = interpolated_rays(origins, directions, state[active, :2])
        s = state[active, 2:]
        residual = points[active] - rays.origin - s * rays.direction
        jacobian = np.stack(
            [
                rays.origin_x + s * rays.direction_x,
                rays.origin_y + s * rays.direction_y,
                rays.direction,
            ],
            axis=-1,
        )
        step = _solve(jacobian, residual)
        step[:, :2] = np.clip(step[:, :2], -size / 4, size / 4)
        before = state[active, :2]
        state[active] += step
        state[active, :2] = np.clip(state[active, :2], -REACH, size - 1 + REACH)
        moved = np.abs(step[:, :2]).max(axis=1)
        moved[~np.isfinite(moved)] = np.inf
        # at the table's border Newton's method steps outwards: no ray passes the point
        stuck = np.abs(state[active, :2] - before).max(axis=1) < _GOOD
        stuck &= moved > 1
        last[active] = np.where(stuck, np.inf, moved)
        active = active[(moved > CLOSE) & np.isfinite(moved) & ~stuck]
        if not len(active):
            break
    good = (last <= _GOOD) & (state[:, 2] > 0)
    return np.where(good[:, None], state[:, :2], np.nan)


def _solve(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solutions ``(N, 3)`` of ``(N, 3, 3)`` systems by Cramer's rule, or NaN."""
    a, b, c = np.moveaxis(matrix, -1, 0)
    bc = np.cross(b, c)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = 1.0 / np.einsum("ij,ij->i", a, bc)
        x = np.einsum("ij,ij->i", right, bc) * inverse
        y = np.einsum("ij,ij->i", right, np.cross(c, a)) * inverse
        z = np.einsum("ij,ij->i", right, np.cross(a, b)) * inverse
        solution = np.stack([x, y, z], axis=1)
    return np.where(np.isfinite(solution).all(axis=1, keepdims=True), solution, np.nan)
