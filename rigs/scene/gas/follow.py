"""Compiled: rays from where they enter a box of gas to where they leave it, as straight pieces."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled
from rigs.scene.gas.spline_steps import CHORD, evaluate, index_by_speed, step

RAYS_AT_ONCE = 4096
"""Rays of one thread's work: fewer cost more in calls, more leave threads idle at the end."""

WIDTH = 7
"""Numbers of a piece: origin, direction, length."""

_TURNS = 64
"""Steps of a ray at most, in the smallest cells along all sides: a straight one takes one."""


def follow(
    coefficients: NDArray[np.float64],
    halvings: NDArray[np.int8],
    medium: float,
    lower: NDArray[np.float64],
    spacing: NDArray[np.float64],
    tolerance: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> tuple[
    NDArray[np.float64],
    NDArray[np.int64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.bool_],
]:
    """Return the pieces ``(P, 7)`` of rays, their counts ``(rays,)``, exits and what was trapped.

    ``coefficients`` ``(nx + 4, ny + 4, nz + 4)`` are of the spline of ``n² - medium²``, from
    number -2 on. ``halvings`` ``(nx + 1, ny + 1, nz + 1)`` say how often each cell is halved for
    steps, from the one before voxel 0's centre on; negative where several are taken together.
    ``lower`` is the box's outer corner, ``spacing`` a voxel's edges; a path is within
    ``tolerance`` of its pieces.
    """
    exits = origins.copy(), directions.copy()
    counts, trapped = np.zeros(len(origins), np.int64), np.zeros(len(origins), np.bool_)

    def some(first: int) -> NDArray[np.float64]:
        last = min(first + RAYS_AT_ONCE, len(origins))
        return _follow(
            coefficients, halvings, medium, lower, spacing, tolerance, origins, directions, first,
            last, counts, *exits, trapped,
        )  # fmt: skip

    starts = range(0, len(origins), RAYS_AT_ONCE)
    threads = min(numba.get_num_threads(), len(starts), os.cpu_count() or 1)
    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(some, starts))
    else:
        parts = [some(start) for start in starts]
    return np.concatenate([np.zeros((0, WIDTH)), *parts]), counts, *exits, trapped


@compiled
def _enter(q, w, count):
    """Move a ray to where it enters the box; return whether it does.

    A ray that runs in a face enters; one that leaves where it starts does not.
    """
    start, stop, entered = 0.0, np.inf, -1
    for axis in range(3):
        low, high = -0.5 - q[axis], count[axis] - 0.5 - q[axis]
        if w[axis] == 0:
            if low > 0 or high < 0:
                return False
            continue
        near, far = low / w[axis], high / w[axis]
        if near > far:
            near, far = far, near
        if near > start:
            start, entered = near, axis
        stop = min(stop, far)
    if not start < stop:
        return False
    for axis in range(3):
        q[axis] = min(max(q[axis] + start * w[axis], -0.5), count[axis] - 0.5)
    if entered >= 0:
        q[entered] = -0.5 if w[entered] > 0 else count[entered] - 0.5
    return True


@compiled
def _outside(q, w, count):
    """Say whether a ray is on a face and leaves, or is beyond it."""
    for axis in range(3):
        low, high = -0.5, count[axis] - 0.5
        if q[axis] < low or q[axis] > high:
            return True
        if (q[axis] == low and w[axis] < 0) or (q[axis] == high and w[axis] > 0):
            return True
    return False


@compiled
def _world(q, w, lower, spacing, place, unit) -> None:
    """Write the position and the unit direction in the world, (3,) each."""
    index = index_by_speed(w, spacing)
    for axis in range(3):
        place[axis] = lower[axis] + (q[axis] + 0.5) * spacing[axis]
        unit[axis] = w[axis] * spacing[axis] / index


@compiled
def _distance(one, other):
    """Return the distance of two points (3,)."""
    square = 0.0
    for axis in range(3):
        square += (one[axis] - other[axis]) ** 2
    return math.sqrt(square)


@compiled
def _write(begin, end, pieces, at):
    """Write the piece from ``begin`` to ``end``, both (3,); return the new end of the pieces."""
    length = _distance(begin, end)
    if length == 0:
        return at
    for axis in range(3):
        pieces[at, axis] = begin[axis]
        pieces[at, 3 + axis] = (end[axis] - begin[axis]) / length
    pieces[at, 6] = length
    return at + 1


@compiled
def _follow(
    coefficients, halvings, medium, lower, spacing, tolerance, origins, directions, first, last,
    counts, exit_origins, exit_directions, trapped,
):  # fmt: skip
    """Return the pieces of the rays ``first:last``, one behind the other. See `follow`."""
    count = np.zeros(3)
    for axis in range(3):
        count[axis] = coefficients.shape[axis] - 4
    most = int(_TURNS * count.sum() * 2.0 ** max(halvings.max(), 0))
    q, w, old_q, old_w = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    room = np.zeros((5, 3)), np.zeros((6, 4))
    begin, place, old_place = np.zeros(3), np.zeros(3), np.zeros(3)
    unit, old_unit, middle = np.zeros(3), np.zeros(3), np.zeros(3)
    pieces, at = np.zeros((4 * (last - first), WIDTH)), 0
    for ray in range(first, last):
        for axis in range(3):
            q[axis] = (origins[ray, axis] - lower[axis]) / spacing[axis] - 0.5
            w[axis] = directions[ray, axis] / spacing[axis]
        if not _enter(q, w, count):
            continue
        square = medium * medium + evaluate(coefficients, q, room[1], room[0][2])
        for axis in range(3):
            w[axis] *= math.sqrt(square)
            room[0][0, axis] = room[0][1, axis] = 0.0
        _world(q, w, lower, spacing, place, unit)
        begin[:] = place
        before, steps, length, turn = at, 0, 0.0, 0.0
        while steps < most and not _outside(q, w, count):
            old_q[:], old_w[:], old_place[:], old_unit[:] = q, w, place, unit
            time = step(coefficients, halvings, medium, spacing, q, w, room)
            _world(q, w, lower, spacing, place, unit)
            steps += 1
            far, angle = _distance(old_place, place), _distance(old_unit, unit)
            parts = max(math.ceil(math.sqrt(CHORD * far * angle / tolerance)), 1)
            while at + parts + 1 >= len(pieces):
                more = np.zeros((2 * len(pieces), WIDTH))
                more[:at] = pieces[:at]
                pieces = more
            for part in range(parts):
                if length > 0 and (
                    CHORD * (length + far / parts) * (turn + angle / parts) > tolerance
                ):
                    _between(part / parts, time, old_q, old_w, q, w, lower, spacing, middle)
                    at = _write(begin, middle, pieces, at)
                    begin[:] = middle
                    length = turn = 0.0
                length += far / parts
                turn += angle / parts
        at = _write(begin, place, pieces, at)
        counts[ray] = at - before
        trapped[ray] = steps >= most
        exit_origins[ray] = place
        exit_directions[ray] = unit
    return pieces[:at]


@compiled
def _between(part, time, old_q, old_w, q, w, lower, spacing, middle):
    """Write the point (3,) at a fraction of a step, by the cubic through both its ends."""
    s = 1 - part
    for axis in range(3):
        found = s * s * (1 + 2 * part) * old_q[axis] + part * part * (1 + 2 * s) * q[axis]
        found += part * s * time * (s * old_w[axis] - part * w[axis])
        middle[axis] = lower[axis] + (found + 0.5) * spacing[axis]
