"""Ray parameters: each ray as two straight lines over its driving axis.

The driving axis ``a`` is the one along which a ray advances most, in voxels; ``b`` and ``c`` are
the two others, in either order. The ray is ``b(t)`` and ``c(t)`` over the position ``t`` along
``a``, all in voxels and ascending: a line integral does not depend on the direction. Where a ray
descends along b or c while it ascends along a, that axis is counted from its other end. Such an
axis is *mirrored*, and its slope is negative.
"""

from __future__ import annotations

import math

import numpy as np

from tomo._compute.jit import compiled
from tomo.operators.on_the_fly.running_sums import TOGETHER
from tomo.rays.ray_box import STILL
from tomo.trace.plane_crossings import voxel_units

START_B, SLOPE_B, START_C, SLOPE_C, ENTER, LEAVE, SCALE = range(7)
"""Columns of the parameters: ``b`` and ``c`` at ``t = 0`` (counted backwards if mirrored), voxels
along them per voxel along a, ``t`` where the ray enters and leaves the grid, and weight times
world length of a step of one voxel along a. A ray without driving axis a, or that
misses the grid, has ENTER equal to LEAVE."""

WIDTH = 8
"""Numbers a ray: one cache line."""


@compiled(inline=True)
def _bounds(position, direction, count, near, far):
    """Clip the interval ``near, far`` of a ray to ``0 <= position <= count`` along one axis."""
    still = abs(direction) < STILL
    per = 1.0 / (1.0 if still else direction)
    lower, upper = -position * per, (count - position) * per
    first, last = (lower, upper) if lower < upper else (upper, lower)
    inside = (position >= 0) & (position <= count)
    first = -np.inf if still else first
    last = (np.inf if inside else -1.0) if still else last
    return (first if first > near else near), (last if last < far else far)


@compiled(inline=True)
def _moving(position, direction, length):
    """Return ``direction``, or zero when the ray stays at ``position`` all along ``length``."""
    return 0.0 if position + direction * length == position else direction


@compiled(inline=True)
def _within(position, count):
    """Return a position along the driving axis, not outside the grid."""
    position = position if position > 0 else 0.0
    return position if position < count else count


@compiled(inline=True)
def _set_parameters(rays, made, some, shape, before_b, before_c, parameters, first, step) -> None:
    """Write the parameters of rays with driving axis a; other rays get none.

    ``rays`` (8, some): origin along a, b, c, in voxels from the lower corner, direction along
    them, in voxels a unit of length, length and weight; one of NaN gets none. ``made`` (7, some)
    is working memory. ``before_b`` and ``before_c`` say whether the driving axis is a where a ray
    is as fast along the other. Written: each ``step``-th row of ``parameters`` (N, 8) from
    ``first``. No branch depends on data, so that the loop vectorises.
    """
    n_a, n_b, n_c = float(shape[0]), float(shape[1]), float(shape[2])
    for k in range(some):
        a, b, c = rays[0, k], rays[1, k], rays[2, k]
        da, db, dc = rays[3, k], rays[4, k], rays[5, k]
        ahead_b = (abs(da) > abs(db)) | (before_b & (abs(da) == abs(db)))
        ahead_c = (abs(da) > abs(dc)) | (before_c & (abs(da) == abs(dc)))
        near, far = 0.0, rays[6, k]
        near, far = _bounds(a, da, n_a, near, far)
        near, far = _bounds(b, db, n_b, near, far)
        near, far = _bounds(c, dc, n_c, near, far)
        chord = far - near
        a, b, c = a + da * near, b + db * near, c + dc * near
        moving = _moving(a, da, chord) != 0
        db, dc = _moving(b, db, chord), _moving(c, dc, chord)
        valid = ahead_b & ahead_c & (far > near) & moving
        end, per = a + da * chord, 1.0 / da
        slope_b, slope_c = db * per, dc * per
        b, c = b - slope_b * a, c - slope_c * a
        made[START_B, k] = n_b - b if slope_b < 0 else b
        made[SLOPE_B, k] = slope_b
        made[START_C, k] = n_c - c if slope_c < 0 else c
        made[SLOPE_C, k] = slope_c
        made[ENTER, k] = _within(a if a < end else end, n_a) if valid else 0.0
        made[LEAVE, k] = _within(end if a < end else a, n_a) if valid else 0.0
        made[SCALE, k] = rays[7, k] * abs(per)
    for k in range(some):
        row = np.uint64(first + k * step)
        for part in range(7):
            parameters[row, part] = made[part, k]


@compiled()
def of_rays(origins, directions, lengths, weights, box, shape, axes, parameters) -> None:
    """Write the parameters (N, 8) of rays, as in `tomo.rays.Rays`, with driving axis ``axes[0]``.

    ``box`` (3, 3) are the grid's corners and spacing, ``shape`` the voxels along a, b, c, ``axes``
    which axes these are; a ray with another driving axis, or that misses, gets none.
    """
    before = axes[0] < axes[1], axes[0] < axes[2]
    rays, made = np.zeros((8, TOGETHER)), np.zeros((7, TOGETHER))
    for first in range(0, len(origins), TOGETHER):
        some = min(TOGETHER, len(origins) - first)
        for k in range(some):
            for part in range(3):
                axis = axes[part]
                rays[part, k] = voxel_units(
                    origins[first + k, axis], box[0, axis], box[1, axis], box[2, axis], shape[part]
                )
                rays[3 + part, k] = directions[first + k, axis] / box[2, axis]
            rays[6, k], rays[7, k] = lengths[first + k], weights[first + k]
        _set_parameters(rays, made, some, shape, before[0], before[1], parameters, first, 1)


@compiled(inline=True)
def _write_numbers(first_pixel, ptr, run, start, some, numbers):
    """Write pixel numbers from ``start`` on, which is in ``run``; return the run of the last."""
    k = 0
    while k < some:
        while ptr[run + 1] <= start + k:
            run += 1
        end = min(ptr[run + 1] - start, some)
        shift = float(first_pixel[run] + (start - ptr[run]))
        for m in range(k, end):
            numbers[m] = shift + m
        k = end
    return run


@compiled(inline=True)
def _write_plane(numbers, some, width, lens, step_down, step_right, rays):
    """Write pixels' positions on the plane at distance one: right, down and ahead."""
    f_x, skew, c_x, f_y, c_y = lens[0], lens[1], lens[2], lens[3], lens[4]
    per_x, per_y, per_width = 1.0 / f_x, 1.0 / f_y, 1.0 / width
    for k in range(some):
        row = np.floor((numbers[k] + 0.5) * per_width)  # faster than integer division
        down = (row + step_down - c_y) * per_y
        rays[0, k] = (numbers[k] - row * width + step_right - c_x - skew * down) * per_x
        rays[1, k] = down
        rays[2, k] = 1.0


@compiled(inline=True)
def _look_past(right, down, rays, some):
    """Turn lines of sight to the rays from a point of the pupil, that far aside in units of focus.

    A line ``x, y, z`` meets the plane in focus, at the distance one, in ``x / z, y / z``.
    """
    for k in range(some):
        per = 1.0 / rays[2, k]
        rays[0, k] = rays[0, k] * per - right
        rays[1, k] = rays[1, k] * per - down
        rays[2, k] = 1.0


@compiled(inline=True)
def _write_directions(rays, weights, share, some, to, start):
    """Turn right, down and ahead into the rays from one point that `_set_parameters` takes."""
    a, b, c = start
    a_right, a_down, a_ahead = to[0, 0], to[0, 1], to[0, 2]
    b_right, b_down, b_ahead = to[1, 0], to[1, 1], to[1, 2]
    c_right, c_down, c_ahead = to[2, 0], to[2, 1], to[2, 2]
    for k in range(some):
        right, down, ahead = rays[0, k], rays[1, k], rays[2, k]
        rays[0, k], rays[1, k], rays[2, k] = a, b, c
        rays[3, k] = right * a_right + down * a_down + ahead * a_ahead
        rays[4, k] = right * b_right + down * b_down + ahead * b_ahead
        rays[5, k] = right * c_right + down * c_down + ahead * c_ahead
        rays[6, k] = np.inf
        length = math.sqrt(right * right + down * down + ahead * ahead)
        rays[7, k] = share * weights[k] * length


@compiled(inline=True)
def _start_at(to, right, down):
    """Return the point that far right and down of the camera, along a, b and c in voxels."""
    return (
        to[0, 3] + right * to[0, 0] + down * to[0, 1],
        to[1, 3] + right * to[1, 0] + down * to[1, 1],
        to[2, 3] + right * to[2, 0] + down * to[2, 1],
    )


@compiled()
def of_pixels(
    first_pixel, ptr, run, start, stop, bend, width, lens, steps, pupil, shares, focus, rotation,
    position, box, shape, axes, parameters,
) -> None:  # fmt: skip
    """Write the parameters of a camera's pixels with driving axis ``axes[0]``.

    Of pixels ``start`` to ``stop``, P in all, by numbers ``row * width + column`` in runs,
    ``first_pixel`` and ``ptr``, of which ``run`` is the first one's (`ray_sources`). ``bend`` is
    what the lens adds to the pinhole's image coordinates (P, K², 2), or the direction in the
    camera's axes (P, K², 3), NaN where none is seen; empty for a lens without distortion. ``lens``
    are fx, skew, cx, fy, cy; ``steps`` (K², 2) a pixel's rays, down and right of its centre;
    ``pupil`` (K², M, 2) the points that each looks from, right and down of the camera, of weights
    ``shares`` (M,); ``focus`` is the distance to the plane in focus, infinite for a pinhole, whose
    M is one; ``rotation`` is from the world to the camera, ``position`` in the world; the rest as
    of `of_rays`.
    """
    several, bent = len(steps), bend.shape[2]
    before = axes[0] < axes[1], axes[0] < axes[2]
    rays, made = np.zeros((8, TOGETHER)), np.zeros((7, TOGETHER))
    numbers, weights = np.zeros(TOGETHER), np.full(TOGETHER, 1.0 / several)
    to = np.zeros((3, 4))
    for part in range(3):
        axis = axes[part]
        for other in range(3):
            to[part, other] = rotation[other, axis] / box[2, axis]
        to[part, 3] = voxel_units(
            position[axis], box[0, axis], box[1, axis], box[2, axis], shape[part]
        )
    for first in range(0, stop - start, TOGETHER):
        some = min(TOGETHER, stop - start - first)
        run = _write_numbers(first_pixel, ptr, run, start + first, some, numbers)
        for k in range(some if bent else 0):
            seen = several
            for part in range(several):
                seen -= math.isnan(bend[first + k, part, 0])
            weights[k] = 1.0 / max(seen, 1)
        for ray in range(several * len(shares)):
            part, point = ray // len(shares), ray % len(shares)
            _write_plane(numbers, some, width, lens, steps[part, 0], steps[part, 1], rays)
            for k in range(some if bent else 0):
                if bent == 2:
                    rays[0, k] += bend[first + k, part, 0]
                    rays[1, k] += bend[first + k, part, 1]
                else:
                    rays[0, k], rays[1, k] = bend[first + k, part, 0], bend[first + k, part, 1]
                    rays[2, k] = bend[first + k, part, 2]
            right, down = pupil[part, point, 0], pupil[part, point, 1]
            if focus < np.inf:
                _look_past(right / focus, down / focus, rays, some)
            from_there = _start_at(to, right, down)
            _write_directions(rays, weights, shares[point], some, to, from_there)
            _set_parameters(
                rays, made, some, shape, before[0], before[1], parameters,
                first * several * len(shares) + ray, several * len(shares),
            )  # fmt: skip
