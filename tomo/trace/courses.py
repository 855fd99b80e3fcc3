"""What rays do in a grid, seen along the axis on which each moves fastest.

The axis along which a ray moves fastest (in voxels) is its *long* axis ``a``; ``b`` and ``c`` are
the two others in their order. A ray is told as two straight lines, ``b(t)`` and ``c(t)`` over the
position ``t`` along ``a``, all in voxels, ascending along every axis: a line integral does not
know which way it was taken, and where a ray descends along b or c while it ascends along a, that
axis is counted from its other end. Such an axis is *mirrored*, and its slope negative.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from tomo._compile import compiled

START_B, SLOPE_B, START_C, SLOPE_C, ENTER, LEAVE, SCALE = range(7)
"""Columns of a course: ``b`` and ``c`` where ``t`` is zero (counted backwards if mirrored), voxels
along them per voxel along a, ``t`` where the ray enters and leaves the grid, and weight times
world length of a step of one voxel along a. A ray that has no course leaves where it enters."""

WIDTH = 8
"""Numbers kept for a course: a line of a processor's cache."""


@compiled(inline=True)
def _bounds(position, direction, count, near, far):
    """Clip the interval ``near, far`` of a ray to ``0 <= position <= count`` along one axis."""
    if direction == 0:
        if position < 0 or position > count:
            return near, -1.0
        return near, far
    per = 1.0 / direction
    to_lower, to_upper = -position * per, (count - position) * per
    if not math.isfinite(per):  # a subnormal component
        to_lower, to_upper = -position / direction, (count - position) / direction
    return max(near, min(to_lower, to_upper)), min(far, max(to_lower, to_upper))


@compiled(inline=True)
def _moving(position, direction, length):
    """Return ``direction``, or zero when the ray stays at ``position`` all along ``length``."""
    return 0.0 if position + direction * length == position else direction


@compiled(inline=True)
def _set_course(x, y, z, dx, dy, dz, length, weight, shape, axis, course):
    """Write the course of a ray with ``axis`` for its long axis; no course for any other ray.

    Parameters
    ----------
    x, y, z, dx, dy, dz : float64
        Origin, in voxels from the lower corner, and direction, in voxels a unit of world length.
    length, weight : float64
    shape : (int, int, int)
    axis : int
    course : (8,) float64
    """
    course[ENTER], course[LEAVE] = 0.0, 0.0
    fastest = 0
    if abs(dy) > abs(dx):
        fastest = 1
    if abs(dz) > max(abs(dx), abs(dy)):
        fastest = 2
    if fastest != axis:
        return
    near, far = 0.0, length
    near, far = _bounds(x, dx, shape[0], near, far)
    near, far = _bounds(y, dy, shape[1], near, far)
    near, far = _bounds(z, dz, shape[2], near, far)
    if not far > near:
        return
    chord = far - near
    x, y, z = x + dx * near, y + dy * near, z + dz * near
    dx, dy, dz = _moving(x, dx, chord), _moving(y, dy, chord), _moving(z, dz, chord)
    if axis == 0:
        a, b, c, da, db, dc = x, y, z, dx, dy, dz
        n_a, n_b, n_c = shape[0], shape[1], shape[2]
    elif axis == 1:
        a, b, c, da, db, dc = y, x, z, dy, dx, dz
        n_a, n_b, n_c = shape[1], shape[0], shape[2]
    else:
        a, b, c, da, db, dc = z, x, y, dz, dx, dy
        n_a, n_b, n_c = shape[2], shape[0], shape[1]
    if da == 0:
        return
    end, per = a + da * chord, 1.0 / da
    slope_b, slope_c = db * per, dc * per
    b, c = b - slope_b * a, c - slope_c * a
    course[START_B], course[SLOPE_B] = (n_b - b if slope_b < 0 else b), slope_b
    course[START_C], course[SLOPE_C] = (n_c - c if slope_c < 0 else c), slope_c
    course[ENTER] = min(max(min(a, end), 0.0), float(n_a))
    course[LEAVE] = min(max(max(a, end), 0.0), float(n_a))
    course[SCALE] = weight * abs(per)


@compiled(inline=True)
def _in_voxels(point, lower, upper, spacing, count):
    """Return a coordinate in voxels from the lower corner, as `VoxelGrid.to_voxel_units` does."""
    position = (point - lower) / spacing
    return min(position, float(count)) if point <= upper else position


@compiled(parallel=True)
def of_rays(origins, directions, lengths, weights, box, shape, axis, courses) -> None:
    """Write the courses of rays (N, ...) with ``axis`` for their long axis.

    Parameters
    ----------
    origins, directions, lengths, weights
        As in `tomo.rays.Rays`.
    box : (3, 3) float64
        The grid's lower and upper corner and its spacing.
    shape : (int, int, int)
    axis : int
    courses : (N, 8) float64
        Written; a ray with another long axis, or one that misses the grid, gets no course.
    """
    for ray in numba.prange(len(origins)):
        _set_course(
            _in_voxels(origins[ray, 0], box[0, 0], box[1, 0], box[2, 0], shape[0]),
            _in_voxels(origins[ray, 1], box[0, 1], box[1, 1], box[2, 1], shape[1]),
            _in_voxels(origins[ray, 2], box[0, 2], box[1, 2], box[2, 2], shape[2]),
            directions[ray, 0] / box[2, 0],
            directions[ray, 1] / box[2, 1],
            directions[ray, 2] / box[2, 2],
            lengths[ray], weights[ray], shape, axis, courses[ray],
        )  # fmt: skip


@compiled(parallel=True)
def of_pixels(
    pixels, bend, width, lens, steps, turned, position, box, shape, axis, courses
) -> None:  # fmt: skip
    """Write the courses of a camera's pixels with ``axis`` for their long axis.

    Parameters
    ----------
    pixels : (P,) int32 or int64
        Flat pixel numbers ``row * width + column``.
    bend : (P, K², 2) float32, (P, K², 3) float64 or (0, 0, 0)
        What the lens adds to the pinhole's image coordinates, or the ray's direction in the
        camera's axes; NaN where no direction is seen. Nothing for a lens without distortion.
    width : int
    lens : (5,) float64
        fx, skew, cx, fy, cy.
    steps : (K², 2) float64
        Where the rays of a pixel are, down and right of its centre.
    turned : (3, 3) float64
        The camera's rotation from the world.
    position : (3,) float64
        The camera, in world coordinates.
    box, shape, axis, courses
        As in `of_rays`; a pixel's rays stand together.
    """
    several, per_width = len(steps), 1.0 / width
    x = _in_voxels(position[0], box[0, 0], box[1, 0], box[2, 0], shape[0])
    y = _in_voxels(position[1], box[0, 1], box[1, 1], box[2, 1], shape[1])
    z = _in_voxels(position[2], box[0, 2], box[1, 2], box[2, 2], shape[2])
    to_x = (turned[0, 0] / box[2, 0], turned[1, 0] / box[2, 0], turned[2, 0] / box[2, 0])
    to_y = (turned[0, 1] / box[2, 1], turned[1, 1] / box[2, 1], turned[2, 1] / box[2, 1])
    to_z = (turned[0, 2] / box[2, 2], turned[1, 2] / box[2, 2], turned[2, 2] / box[2, 2])
    bent = bend.shape[2]
    for place in numba.prange(len(pixels)):
        row = np.floor((pixels[place] + 0.5) * per_width)  # faster than by whole numbers
        column = pixels[place] - row * width
        seen = several
        for part in range(several if bent else 0):
            seen -= math.isnan(bend[place, part, 0])
        for part in range(several):
            ray = place * several + part
            down = (row + steps[part, 0] - lens[4]) / lens[3]
            right = (column + steps[part, 1] - lens[2] - lens[1] * down) / lens[0]
            ahead = 1.0
            if bent == 2:
                right += bend[place, part, 0]
                down += bend[place, part, 1]
            elif bent == 3:
                right, down = bend[place, part, 0], bend[place, part, 1]
                ahead = bend[place, part, 2]
            if math.isnan(right):
                courses[ray, ENTER], courses[ray, LEAVE] = 0.0, 0.0
                continue
            _set_course(
                x, y, z,
                right * to_x[0] + down * to_x[1] + ahead * to_x[2],
                right * to_y[0] + down * to_y[1] + ahead * to_y[2],
                right * to_z[0] + down * to_z[1] + ahead * to_z[2],
                np.inf, math.sqrt(right * right + down * down + ahead * ahead) / seen,
                shape, axis, courses[ray],
            )  # fmt: skip
