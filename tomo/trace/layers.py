"""Where a ray passes the layers of voxels across one axis, in fixed point.

The axis along which a ray moves fastest (in voxels) is its *long* axis ``a``; ``b`` and ``c`` are
the two others in their order. Every ray is told so that it ascends along ``a`` (a line integral
does not know which way it was taken) and along ``b`` and ``c`` too (else the voxels are counted
from the other end: *mirrored*). Positions on ``b`` and ``c`` are whole multiples of ``2^-bits``
voxels, so that the position at face ``f`` of the layers, ``start + f * slope``, is exact, and so
is in which voxel it is and whether a face of it was passed since the last layer.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import DTypeLike

from tomo._compile import compiled

START_B, SLOPE_B, START_C, SLOPE_C, FIRST, COUNT, MIRROR_B, MIRROR_C = range(8)
"""Columns of a course's whole numbers: positions at the lower face of the first layer and slopes
along b and c, the first layer, how many there are, and whether b and c are counted backwards."""

PER_B, PER_C, ENTER, LEAVE, SCALE = range(5)
"""Columns of its real numbers: layers per position unit along b and c, where the ray enters and
leaves the box in layers from the first, and weight times world length a layer."""


def fixed_point(shape: tuple[int, int, int], real: DTypeLike) -> tuple[type, int]:
    """Return the whole numbers' type and the bits behind the point for a grid.

    What fits a vector of ``real`` as often as ``real`` itself, unless a long grid would leave the
    positions coarser than single precision is, or its voxels' numbers did not fit.
    """
    longest = max(shape) + 1
    stored = math.prod(n + 1 for n in shape)
    if np.dtype(real) == np.float32 and longest < 1024 and stored < 2**31:
        return np.int32, min(23, 31 - longest.bit_length())
    return np.int64, min(52, 63 - longest.bit_length())


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
def _across(
    position, slope, to_first, count, one, whole, real, at_start, at_slope, at_mirror, per
):
    """Write a ray's course along one axis across the long one."""
    mirrored = slope < 0
    if mirrored:
        position, slope = count - position, -slope
    start = math.floor((position + slope * to_first) * one)
    step = math.floor(slope * one + 0.5)
    if step > 0:
        real[per] = 1.0 / step
    else:  # nowhere near a face, so that it never passes one
        start = math.floor(start / one) * one + one / 2
        real[per] = 4.0 / one
    whole[at_start], whole[at_slope], whole[at_mirror] = int(start), int(step), int(mirrored)


@compiled(inline=True)
def _set_course(x, y, z, dx, dy, dz, length, weight, shape, axis, bits, whole, real):
    """Write the course of a ray with ``axis`` for its long axis; zero layers for any other ray.

    Parameters
    ----------
    x, y, z, dx, dy, dz : float64
        Origin, in voxels from the lower corner, and direction, in voxels a unit of world length.
    length, weight : float64
    shape : (int, int, int)
    axis, bits : int
    whole : (8,) int64
    real : (5,) float64
    """
    whole[COUNT] = 0
    near, far = 0.0, length
    near, far = _bounds(x, dx, shape[0], near, far)
    near, far = _bounds(y, dy, shape[1], near, far)
    near, far = _bounds(z, dz, shape[2], near, far)
    if not far > near:
        return
    chord = far - near
    x, y, z = x + dx * near, y + dy * near, z + dz * near
    dx, dy, dz = _moving(x, dx, chord), _moving(y, dy, chord), _moving(z, dz, chord)
    fastest = 0
    if abs(dy) > abs(dx):
        fastest = 1
    if abs(dz) > max(abs(dx), abs(dy)):
        fastest = 2
    if fastest != axis:
        return
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
    if da < 0:
        a, b, c = a + da * chord, b + db * chord, c + dc * chord
        da, db, dc = -da, -db, -dc
    end = a + da * chord
    first = min(max(math.floor(a), 0), n_a - 1)
    last = min(max(math.ceil(end), first + 1), n_a)
    one = 2.0**bits
    whole[FIRST], whole[COUNT] = first, last - first
    per = 1.0 / da
    _across(b, db * per, first - a, n_b, one, whole, real, START_B, SLOPE_B, MIRROR_B, PER_B)
    _across(c, dc * per, first - a, n_c, one, whole, real, START_C, SLOPE_C, MIRROR_C, PER_C)
    real[ENTER], real[LEAVE], real[SCALE] = a - first, end - first, weight * per


@compiled(inline=True)
def _in_voxels(point, lower, upper, spacing, count):
    """Return a coordinate in voxels from the lower corner, as `VoxelGrid.to_voxel_units` does."""
    position = (point - lower) / spacing
    return min(position, float(count)) if point <= upper else position


@compiled(parallel=True)
def of_rays(origins, directions, lengths, weights, box, shape, axis, bits, whole, real) -> None:
    """Write the courses of rays (N, ...) with ``axis`` for their long axis.

    Parameters
    ----------
    origins, directions, lengths, weights
        As in `tomo.rays.Rays`.
    box : (3, 3) float64
        The grid's lower and upper corner and its spacing.
    shape : (int, int, int)
    axis, bits : int
    whole : (N, 8) int64
    real : (N, 5) float64
        Written; a ray with another long axis, or one that misses the grid, gets no layers.
    """
    for ray in numba.prange(len(origins)):
        _set_course(
            _in_voxels(origins[ray, 0], box[0, 0], box[1, 0], box[2, 0], shape[0]),
            _in_voxels(origins[ray, 1], box[0, 1], box[1, 1], box[2, 1], shape[1]),
            _in_voxels(origins[ray, 2], box[0, 2], box[1, 2], box[2, 2], shape[2]),
            directions[ray, 0] / box[2, 0],
            directions[ray, 1] / box[2, 1],
            directions[ray, 2] / box[2, 2],
            lengths[ray], weights[ray], shape, axis, bits, whole[ray], real[ray],
        )  # fmt: skip


@compiled(parallel=True)
def of_pixels(
    pixels, bend, width, lens, steps, turned, position, box, shape, axis, bits, whole, real
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
    steps : (K,) float64
        Places of the rays of a pixel along one side of it.
    turned : (3, 3) float64
        The camera's rotation from the world.
    position : (3,) float64
        The camera, in world coordinates.
    box, shape, axis, bits, whole, real
        As in `of_rays`; a pixel's rays stand together.
    """
    per_side, several = len(steps), len(steps) ** 2
    x = _in_voxels(position[0], box[0, 0], box[1, 0], box[2, 0], shape[0])
    y = _in_voxels(position[1], box[0, 1], box[1, 1], box[2, 1], shape[1])
    z = _in_voxels(position[2], box[0, 2], box[1, 2], box[2, 2], shape[2])
    to_x = (turned[0, 0] / box[2, 0], turned[1, 0] / box[2, 0], turned[2, 0] / box[2, 0])
    to_y = (turned[0, 1] / box[2, 1], turned[1, 1] / box[2, 1], turned[2, 1] / box[2, 1])
    to_z = (turned[0, 2] / box[2, 2], turned[1, 2] / box[2, 2], turned[2, 2] / box[2, 2])
    bent = bend.shape[2]
    for place in numba.prange(len(pixels)):
        column, row = pixels[place] % width, pixels[place] // width
        seen = several
        for part in range(several if bent else 0):
            seen -= math.isnan(bend[place, part, 0])
        for part in range(several):
            ray = place * several + part
            down = (row + steps[part // per_side] - lens[4]) / lens[3]
            right = (column + steps[part % per_side] - lens[2] - lens[1] * down) / lens[0]
            ahead = 1.0
            if bent == 2:
                right += bend[place, part, 0]
                down += bend[place, part, 1]
            elif bent == 3:
                right, down = bend[place, part, 0], bend[place, part, 1]
                ahead = bend[place, part, 2]
            if math.isnan(right):
                whole[ray, COUNT] = 0
                continue
            per = 1.0 / math.sqrt(right * right + down * down + ahead * ahead)
            right, down, ahead = right * per, down * per, ahead * per
            _set_course(
                x, y, z,
                right * to_x[0] + down * to_x[1] + ahead * to_x[2],
                right * to_y[0] + down * to_y[1] + ahead * to_y[2],
                right * to_z[0] + down * to_z[1] + ahead * to_z[2],
                np.inf, 1.0 / seen, shape, axis, bits, whole[ray], real[ray],
            )  # fmt: skip
