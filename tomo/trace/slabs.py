"""Project through a volume slab by slab, with no stored matrix: forward and its exact transpose.

A slab is one layer of voxels across a ray's long axis (`tomo.trace.layers`). A *column* is a row of
voxels along that axis. At every face between two slabs the ray is in one column, which it entered
some way before the face, perhaps in the slab below, and leaves some way after it: so each face gives
the length in the voxel below it, from where the ray entered the column (or nothing, where it was in
the same column a slab earlier: that length was counted at the face before), and the length in the
voxel above, until the ray leaves the column or the slab. Where a ray enters two columns within one
slab there is a third voxel, the *corner* between them. Positions are exact multiples of the slope,
never accumulated, so the faces are independent and the loop over them vectorises; it has no branch
that depends on data. The forward and the adjoint use the same lengths.

The volume lies column by column (`tomo.trace.columns`), so that the two voxels of a face are
neighbours in memory and a ray walks along the memory.

The adjoint gives each thread the columns of a range along b or c; a ray's faces in such a range
follow each other and are found by an exact division. Each voxel's sum is in the order of the rays,
whoever owns it, so the bits do not depend on the number of threads, nothing is written twice at a
time, and no thread has a volume of its own.
"""

from __future__ import annotations

import numba
import numpy as np

from tomo._compile import compiled
from tomo.trace._pairs import add_pairs, dot_pairs, shifted_right
from tomo.trace.bricks import BRICK_BITS, CHUNK
from tomo.trace.layers import (
    COUNT,
    ENTER,
    FIRST,
    LEAVE,
    MIRROR_B,
    MIRROR_C,
    PER_B,
    PER_C,
    SCALE,
    SLOPE_B,
    SLOPE_C,
    START_B,
    START_C,
)

RAYS_TOGETHER = 64  # pixels that a thread takes at a time


@compiled(inline=True)
def _faces(whole, real, bits, last_b, last_c, stride_b, stride_c, start, stop, index, weight, corner):
    """Write what a ray's faces ``start`` to ``stop`` give, and say whether there are corners.

    Face ``f`` gets ``index[f - start]``, the place of the voxel below it, ``weight[2 (f - start)]``,
    the length below and above it in slabs, and ``corner[f - start]``, the length in the corner;
    negative if b was passed last.
    """
    number, length = index.dtype.type, weight.dtype.type
    start_b, slope_b = number(whole[START_B]), number(whole[SLOPE_B])
    start_c, slope_c = number(whole[START_C]), number(whole[SLOPE_C])
    per_b, per_c = length(real[PER_B]), length(real[PER_C])
    enter, leave = length(real[ENTER]), length(real[LEAVE])
    count = number(whole[COUNT])
    step_b, step_c = number(stride_b), number(stride_c)
    base = number(whole[FIRST])
    if whole[MIRROR_B]:
        base = number(base + last_b * stride_b)
        step_b = number(-stride_b)
    if whole[MIRROR_C]:
        base = number(base + last_c * stride_c)
        step_c = number(-stride_c)
    high_b, high_c = number(last_b), number(last_c)
    none, unit = length(0), length(1)
    places = number(bits)
    fraction = number((1 << bits) - 1)
    one = length(1 << bits)
    first = number(start)
    corners = none
    for k in range((stop - start + CHUNK - 1) & -CHUNK):
        face = number(first + number(k))
        at = length(face)
        face = min(face, count)
        b = number(start_b + number(face * slope_b))
        c = number(start_c + number(face * slope_c))
        in_b, in_c = number(b & fraction), number(c & fraction)
        past_b, past_c = length(in_b), length(in_c)
        since_b, since_c = past_b * per_b, past_c * per_c
        hit_b, hit_c = in_b < slope_b, in_c < slope_c
        inside, left = at - enter, leave - at
        above = min(min((one - past_b) * per_b, (one - past_c) * per_c), min(left, unit))
        above = max(above - max(enter - at, none), none)
        beyond = max(at - leave, none)
        below = max(min(min(since_b, since_c), inside) - beyond, none)
        between = min(max(since_b, since_c), inside) - max(min(since_b, since_c), beyond)
        between = max(between, none) if hit_b & hit_c else none
        column_b = min(max(shifted_right(b, places), number(0)), high_b)
        column_c = min(max(shifted_right(c, places), number(0)), high_c)
        place = number(number(column_b * step_b) + number(column_c * step_c))
        index[k] = number(number(base + face) + place)
        weight[2 * k] = below if hit_b | hit_c else none
        weight[2 * k + 1] = above
        corner[k] = -between if since_b < since_c else between
        corners += between
    return corners > none


@compiled(inline=True)
def _corner(whole, bits, last_b, last_c, stride_b, stride_c, face, b_last):
    """Return the column of the corner in the slab below a face, and the place of its voxel."""
    face = min(face, whole[COUNT])
    b = (whole[START_B] + face * whole[SLOPE_B]) >> bits
    c = (whole[START_C] + face * whole[SLOPE_C]) >> bits
    if b_last:
        b -= 1
    else:
        c -= 1
    b, c = min(max(b, 0), last_b), min(max(c, 0), last_c)
    place_b = last_b - b if whole[MIRROR_B] else b
    place_c = last_c - c if whole[MIRROR_C] else c
    return b, c, place_b * stride_b + place_c * stride_c + whole[FIRST] + face


@compiled(inline=True)
def _is_live(whole, bits, last_b, last_c, bricks, brick_strides, start):
    """Say whether a live voxel is near the chunk of faces that begins with ``start``."""
    face = min(start + CHUNK // 2, whole[COUNT])
    b = min(max((whole[START_B] + face * whole[SLOPE_B]) >> bits, 0), last_b)
    c = min(max((whole[START_C] + face * whole[SLOPE_C]) >> bits, 0), last_c)
    b = last_b - b if whole[MIRROR_B] else b
    c = last_c - c if whole[MIRROR_C] else c
    a = whole[FIRST] + min(face, whole[COUNT] - 1)
    return bricks[
        (a >> BRICK_BITS) * brick_strides[0]
        + (b >> BRICK_BITS) * brick_strides[1]
        + (c >> BRICK_BITS) * brick_strides[2]
    ]


@compiled(inline=True)
def _next_run(whole, bits, last_b, last_c, bricks, brick_strides, start, stop):
    """Return the next run of faces from ``start`` on that has live voxels near; empty at the end.

    A run begins a whole number of chunks after ``start``.
    """
    if len(bricks) == 0:
        return start, stop
    while start < stop and not _is_live(
        whole, bits, last_b, last_c, bricks, brick_strides, start
    ):
        start += CHUNK
    end = start
    while end < stop and _is_live(whole, bits, last_b, last_c, bricks, brick_strides, end):
        end += CHUNK
    return min(start, stop), min(end, stop)


@compiled(parallel=True, reassociate=True)
def forward(
    whole, real, pixel_ptr, shape, bits, number, bricks, brick_strides, threads, columns, images
) -> None:  # fmt: skip
    """Add to ``images`` (P,) the projections of a volume.

    Parameters
    ----------
    whole, real : (N, 8) int64, (N, 5) float64
        Courses of rays with one long axis, as `tomo.trace.layers` writes them.
    pixel_ptr : (P + 1,) int64
    shape : (3,) int
        Voxels along the axes a, b, c.
    bits : int
    number : (0,) int32 or int64
        Of which type places are.
    bricks, brick_strides : uint8, (3,) int
        Where voxels are live (`tomo.trace.bricks`), along a, b, c; empty where all are.
    threads : int
        Between which the pixels are dealt out in turn.
    columns : float32 or float64
        The volume, column by column.
    """
    stride_c = shape[0] + 1
    stride_b = stride_c * shape[2]
    last_b, last_c = shape[1] - 1, shape[2] - 1
    length = columns.dtype.type
    room = shape[0] + 1 + CHUNK
    pixels = len(images)
    rounds = -(-pixels // (RAYS_TOGETHER * threads))
    for turn in numba.prange(rounds * threads):
        index = np.zeros(room, number.dtype)
        weight = np.zeros(2 * room, columns.dtype)
        corner = np.zeros(room, columns.dtype)
        group = (turn % rounds) * threads + turn // rounds
        for pixel in range(group * RAYS_TOGETHER, min((group + 1) * RAYS_TOGETHER, pixels)):
            together = 0.0
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                if whole[ray, COUNT] == 0:
                    continue
                course = whole[ray]
                total = length(0)
                stop = course[COUNT] + 1
                start, end = _next_run(
                    course, bits, last_b, last_c, bricks, brick_strides, 0, stop
                )
                while start < end:
                    corners = _faces(
                        course, real[ray], bits, last_b, last_c, stride_b, stride_c, start, end,
                        index, weight, corner,
                    )  # fmt: skip
                    total += dot_pairs(columns, index, weight, (end - start + 7) & -8)
                    for k in range(end - start if corners else 0):
                        if corner[k] != 0:
                            _, _, at = _corner(
                                course, bits, last_b, last_c, stride_b, stride_c, start + k,
                                corner[k] < 0,
                            )  # fmt: skip
                            total += abs(corner[k]) * columns[at]
                    if end == stop:
                        break
                    start, end = _next_run(
                        course, bits, last_b, last_c, bricks, brick_strides, end, stop
                    )
                together += real[ray, SCALE] * total
            images[pixel] += together


@compiled(inline=True)
def _faces_in_range(start, slope, mirrored, last, low, high, bits, stop):
    """Return the run of faces of a ray that are in the columns ``low`` to ``high`` of one axis."""
    if mirrored:
        low, high = last + 1 - high, last + 1 - low
    first, end = 0, stop
    if low > 0 and (start >> bits) < low:
        behind = (low << bits) - start
        first = min(-(-behind // slope), stop) if slope > 0 else stop
    if high <= last:
        behind = (high << bits) - start
        if behind <= 0:
            end = 0
        elif slope > 0:
            end = min(-(-behind // slope), stop)
    return first, max(first, end)


@compiled(parallel=True)
def adjoint(
    whole, real, pixel_ptr, shape, bits, number, bricks, brick_strides, cuts, own, images, columns
) -> None:  # fmt: skip
    """Add to ``columns``, a volume column by column, the back-projection of ``images`` (P,).

    Part ``p`` owns the columns from ``cuts[p]`` to ``cuts[p + 1]`` of axis b (``own`` 1) or c
    (``own`` 2); other parameters as in `forward`.
    """
    stride_c = shape[0] + 1
    stride_b = stride_c * shape[2]
    last_b, last_c = shape[1] - 1, shape[2] - 1
    last = shape[own] - 1
    at_start = START_B if own == 1 else START_C
    at_slope = SLOPE_B if own == 1 else SLOPE_C
    at_mirror = MIRROR_B if own == 1 else MIRROR_C
    length = columns.dtype.type
    room = shape[0] + 1 + CHUNK
    for part in numba.prange(len(cuts) - 1):
        low, high = cuts[part], cuts[part + 1]
        index = np.zeros(room, number.dtype)
        weight = np.zeros(2 * room, columns.dtype)
        corner = np.zeros(room, columns.dtype)
        for pixel in range(len(images) if low < high else 0):
            if images[pixel] == 0:
                continue
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                if whole[ray, COUNT] == 0:
                    continue
                course = whole[ray]
                stop = course[COUNT] + 1
                mine, others = _faces_in_range(
                    course[at_start], course[at_slope], course[at_mirror], last, low, high, bits,
                    stop,
                )  # fmt: skip
                # The corner below the next part's first face may be mine.
                upto = min(others + 1, stop)
                if mine >= upto:
                    continue
                factor = length(images[pixel] * real[ray, SCALE])
                start, end = _next_run(
                    course, bits, last_b, last_c, bricks, brick_strides, mine & -CHUNK, upto
                )
                while start < end:
                    begin = max(start, mine)
                    corners = _faces(
                        course, real[ray], bits, last_b, last_c, stride_b, stride_c, begin, end,
                        index, weight, corner,
                    )  # fmt: skip
                    add_pairs(columns, index, weight, min(end, others) - begin, factor)
                    for k in range(end - begin if corners else 0):
                        if corner[k] != 0:
                            b, c, at = _corner(
                                course, bits, last_b, last_c, stride_b, stride_c, begin + k,
                                corner[k] < 0,
                            )  # fmt: skip
                            layer = b if own == 1 else c
                            layer = last - layer if course[at_mirror] else layer
                            if low <= layer < high:
                                columns[at] += abs(corner[k]) * factor
                    if end == upto:
                        break
                    start, end = _next_run(
                        course, bits, last_b, last_c, bricks, brick_strides, end, upto
                    )
