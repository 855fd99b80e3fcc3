"""Compiled: rays through a cubic B-spline of the squared refractive index.

With ``dt = ds / n`` the ray equation ``d/ds (n dx/ds) = grad n`` becomes

    x'' = grad(n²) / 2,    |x'| = n

(Sharma, Kumar and Ghatak, Applied Optics 21, 1982), an equation of motion without friction. It is
solved in voxel units by the two-stage Gauss method, a Runge-Kutta method of order 4 (Hairer,
Lubich and Wanner, Geometric Numerical Integration, II.1.3). The spline is a polynomial in each
cell between voxel centres; a step ends where the ray leaves its cell, so that no step sees a jump
of the third derivatives. Method, cells and the projection onto ``|x'| = n`` are the same seen from
both ends of a step: a ray sent back retraces its way to rounding, whatever a step's error is.
"""

from __future__ import annotations

import math

import numpy as np

from rigs.compiled import compiled

CHORD = 0.25
"""A path of length S whose direction turns by a, altogether, is within ``CHORD * S * a`` of the
chord of its ends: a bound that a kink in the middle reaches; an arc of a circle takes half."""

CONVERGED = 1e-14
"""Change of the way, in voxels, below which a step is solved: rounding."""

ITERATIONS = 60
"""Iterations of a step at most. Gas takes 3 or 4; an index that jumps from voxel to voxel, for
which no cubic holds, more."""

_R = math.sqrt(3) / 6
_C1, _C2 = 0.5 - _R, 0.5 + _R
_A11, _A12 = 1 / 24, 1 / 8 - _R / 2  # the square of [[1/4, 1/4 - R], [1/4 + R, 1/4]]
_A21, _A22 = 1 / 8 + _R / 2, 1 / 24
_B1, _B2 = 0.25 + _R / 2, 0.25 - _R / 2

AT_REST = 1e-13
"""Voxels along an axis, while the fastest axis takes one, that count as none: rounding would say
when, or whether, the ray leaves."""

NEVER = np.inf


@compiled
def spline_weights(t, weights, slopes) -> None:
    """Write the values (4,) and slopes (4,) of the B-splines around a cell, at ``0 <= t <= 1``."""
    s = 1 - t
    weights[0], weights[3] = s * s * s / 6, t * t * t / 6
    weights[1] = (4 - 3 * t * t * (1 + s)) / 6
    weights[2] = (4 - 3 * s * s * (1 + t)) / 6
    slopes[0], slopes[3] = -s * s / 2, t * t / 2
    slopes[1], slopes[2] = t * (1.5 * t - 2), s * (2 - 1.5 * s)


@compiled
def evaluate(coefficients, q, scratch, slope) -> float:
    """Return the spline at ``q`` (3,) in voxel units from voxel 0's centre; write its slope (3,).

    ``coefficients`` (nx + 4, ny + 4, nz + 4) begin at spline number -2; ``scratch`` is (6, 4).
    """
    x = min(max(math.floor(q[0]), -1), coefficients.shape[0] - 5)
    y = min(max(math.floor(q[1]), -1), coefficients.shape[1] - 5)
    z = min(max(math.floor(q[2]), -1), coefficients.shape[2] - 5)
    spline_weights(q[0] - x, scratch[0], scratch[1])
    spline_weights(q[1] - y, scratch[2], scratch[3])
    spline_weights(q[2] - z, scratch[4], scratch[5])
    value = along_x = along_y = along_z = 0.0
    for i in range(4):
        row = row_y = row_z = 0.0
        for j in range(4):
            line = coefficients[x + 1 + i, y + 1 + j]
            a, b, c, d = line[z + 1], line[z + 2], line[z + 3], line[z + 4]
            w, v = scratch[4], scratch[5]
            here = a * w[0] + b * w[1] + c * w[2] + d * w[3]
            row += scratch[2, j] * here
            row_y += scratch[3, j] * here
            row_z += scratch[2, j] * (a * v[0] + b * v[1] + c * v[2] + d * v[3])
        value += scratch[0, i] * row
        along_x += scratch[1, i] * row
        along_y += scratch[0, i] * row_y
        along_z += scratch[0, i] * row_z
    slope[0], slope[1], slope[2] = along_x, along_y, along_z
    return value


@compiled
def _cell(q, w, cells) -> int:
    """Return the number along an axis of the cell that a ray is in, or moves into."""
    below = math.floor(q) if w >= 0 else math.ceil(q) - 1
    return min(max(below + 1, 0), cells - 1)


@compiled
def _time_to_leave(q, speed, half, count, parts):
    """Return when ``q + speed t + half t²`` first is at an end of its cell, and at which.

    ``count`` are the voxels along the axis, ``parts`` those of a cell. A ray on a plane is in the
    part that it moves into. It reaches the plane ahead, unless it turns before: then the plane
    behind.
    """
    forward = speed > 0 or (speed == 0 and half > 0)
    if forward:
        behind = math.floor(q * parts) / parts
        ahead = behind + 1 / parts
    else:
        behind = math.ceil(q * parts) / parts
        ahead = behind - 1 / parts
    ahead = min(max(ahead, -0.5), count - 0.5)
    behind = min(max(behind, -0.5), count - 0.5)
    square = speed * speed + 4 * half * (ahead - q)
    if square >= 0:
        total = speed + math.sqrt(square) if forward else speed - math.sqrt(square)
        return 2 * (ahead - q) / total, ahead
    root = math.sqrt(speed * speed + 4 * half * (behind - q))
    return -(speed + root if forward else speed - root) / (2 * half), behind


@compiled
def index_by_speed(w, spacing) -> float:
    """Return ``|x'|`` in world lengths of a velocity (3,) in voxel units."""
    square = 0.0
    for axis in range(3):
        square += (w[axis] * spacing[axis]) ** 2
    return math.sqrt(square)


@compiled
def step(coefficients, halvings, medium, spacing, q, w, room) -> float:
    """Move a ray to the next face of a cell, or of its parts; return the time that it takes.

    ``q, w`` (3,) are position and velocity in voxel units, overwritten; ``room`` (5, 3), (6, 4)
    holds the accelerations of both stages, a guess that is overwritten, and working memory. A
    step's own error changes ``|x'|``, which has to be ``n``. The step therefore begins with the
    velocity times ``1 + m`` and ends with it over ``1 - m``, with the ``m`` that makes it ``n`` at
    the end: a projection that is the same from both ends (Hairer, BIT 40, 2000).
    """
    forces, (end, slope, at), scratch = room[0][:2], room[0][2:], room[1]
    x, y, z = halvings.shape
    halved = halvings[_cell(q[0], w[0], x), _cell(q[1], w[1], y), _cell(q[2], w[2], z)]
    parts = 2.0**halved
    time, axis_ahead, plane_ahead, before, m = 0.0, -1, 0.0, 0.0, 0.0
    index = speed = 1.0
    fastest = max(abs(w[0]), abs(w[1]), abs(w[2]))
    for iteration in range(ITERATIONS):
        time = NEVER
        for axis in range(3):
            half = _B1 * forces[0, axis] + _B2 * forces[1, axis]
            if abs(w[axis]) * fastest + abs(half) < AT_REST * fastest * fastest:
                continue
            soonest, plane = _time_to_leave(
                q[axis], (1 + m) * w[axis], half, coefficients.shape[axis] - 4.0, parts
            )
            if soonest < time:
                time, axis_ahead, plane_ahead = soonest, axis, plane
        square, change = time * time, 0.0
        for stage in range(2):
            c, one, two = (_C1, _A11, _A12) if stage == 0 else (_C2, _A21, _A22)
            for axis in range(3):
                bend = one * forces[0, axis] + two * forces[1, axis]
                at[axis] = q[axis] + c * time * (1 + m) * w[axis] + square * bend
            evaluate(coefficients, at, scratch, slope)
            for axis in range(3):
                force = slope[axis] / (2 * spacing[axis] * spacing[axis])
                change = max(change, abs(force - forces[stage, axis]) * square)
                forces[stage, axis] = force
        converged = change * min(change / before if before > 0 else 1.0, 1.0) < CONVERGED
        before = change
        if not converged and iteration < ITERATIONS - 1:
            continue
        for axis in range(3):
            bend = _B1 * forces[0, axis] + _B2 * forces[1, axis]
            at[axis] = q[axis] + time * (1 + m) * w[axis] + square * bend
            end[axis] = (1 + m) * w[axis] + time * (forces[0, axis] + forces[1, axis]) / 2
        at[axis_ahead] = plane_ahead
        index = math.sqrt(medium * medium + evaluate(coefficients, at, scratch, slope))
        speed = index_by_speed(end, spacing)
        missing = 1 - speed / index - m
        m += missing / 2
        bend = 0.0
        for axis in range(3):
            bend = max(bend, abs(forces[0, axis] + forces[1, axis]) * time)
        if converged and abs(missing) * bend < CONVERGED * fastest:
            break  # another speed changes the way by no more
    for axis in range(3):
        q[axis], w[axis] = at[axis], end[axis] * index / speed
    return time
