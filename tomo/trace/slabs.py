"""Project through a volume slab by slab, with no stored matrix: forward and its exact transpose.

A slab is one layer of voxels across a ray's long axis (`tomo.trace.layers`). A *column* is a row
of voxels along that axis. At every face between two slabs the ray is in one column, which it
entered some way before the face, perhaps in the slab below, and leaves some way after it: so each
face gives the length in the voxel below it, from where the ray entered the column (or nothing,
where it was in the same column a slab earlier: that length was counted at the face before), and
the length in the voxel above, until the ray leaves the column or the slab. Where a ray enters two
columns within one slab there is a third voxel, the *corner* between them. Positions are exact
multiples of the slope, never accumulated, so the faces are independent and the loop over them
vectorises; it has no branch that depends on data. Forward and adjoint use the same lengths.

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

RAYS_TOGETHER = 256  # pixels that a thread takes at a time


@compiled(inline=True)
def _line(whole, real, bits, last_b, last_c, stride_b, stride_c, index, length):
    """Return what `_face` needs of a ray, as the types ``index`` and ``length``."""
    step_b, step_c, base = index(stride_b), index(stride_c), index(whole[FIRST])
    if whole[MIRROR_B]:
        base, step_b = index(base + last_b * stride_b), index(-stride_b)
    if whole[MIRROR_C]:
        base, step_c = index(base + last_c * stride_c), index(-stride_c)
    return (
        index(whole[START_B]), index(whole[SLOPE_B]), length(real[PER_B]), index(last_b), step_b,
        index(whole[START_C]), index(whole[SLOPE_C]), length(real[PER_C]), index(last_c), step_c,
        index(whole[COUNT]), length(real[ENTER]), length(real[LEAVE]), base,
        index(bits), index((1 << bits) - 1), length(1 << bits),
    )  # fmt: skip


@compiled(inline=True)
def _face(face, line, index, length):
    """Return what a ray does at a face.

    Returns
    -------
    place : int
        Of the voxel below the face; the one above follows it.
    below, above : real
        The ray's length in both, in slabs.
    amid, corner : int, real
        The place of the corner voxel and the length there; the voxel below and zero without one.
    both : bool
        Whether there is a corner.
    """
    (
        start_b, slope_b, per_b, high_b, step_b, start_c, slope_c, per_c, high_c, step_c,
        count, enter, leave, base, places, fraction, one,
    ) = line  # fmt: skip
    none, unit, nothing = length(0), length(1), index(0)
    at = length(face)
    face = min(face, count)
    b = index(start_b + index(face * slope_b))
    c = index(start_c + index(face * slope_c))
    in_b, in_c = index(b & fraction), index(c & fraction)
    past_b, past_c = length(in_b), length(in_c)
    since_b, since_c = past_b * per_b, past_c * per_c
    hit_b, hit_c = in_b < slope_b, in_c < slope_c
    above = min(min((one - past_b) * per_b, (one - past_c) * per_c), min(leave - at, unit))
    above = max(above - max(enter - at, none), none)
    sooner, later = max(since_b, since_c), min(since_b, since_c)  # how long ago
    inside, beyond = at - enter, max(at - leave, none)
    below = max(min(later, inside) - beyond, none)
    corner = max(min(sooner, inside) - max(later, beyond), none)
    b, c = shifted_right(b, places), shifted_right(c, places)
    column_b, column_c = min(max(b, nothing), high_b), min(max(c, nothing), high_c)
    place = index(index(column_b * step_b) + index(column_c * step_c))
    place = index(index(base + face) + place)
    b_last = since_b < since_c
    column, high = (b, high_b) if b_last else (c, high_c)
    back = (step_b if b_last else step_c) if (column > nothing) & (column <= high) else nothing
    both = hit_b & hit_c
    return (
        place,
        below if hit_b | hit_c else none,
        above,
        index(place - back) if both else place,
        corner if both else none,
        both,
    )


@compiled(inline=True)
def _faces(start, stop, line, places, lengths, amid, corners):
    """Write what `_face` returns for faces ``start`` to ``stop``; say if there are corners.

    ``lengths`` holds below and above in turn.
    """
    index, length = places.dtype.type, lengths.dtype.type
    first = index(start)
    some = index(0)
    for k in range((stop - start + CHUNK - 1) & -CHUNK):
        place, below, above, between, corner, both = _face(
            index(first + index(k)), line, index, length
        )
        places[k] = place
        lengths[2 * k] = below
        lengths[2 * k + 1] = above
        amid[k] = between
        corners[k] = corner
        some = index(some | index(both))
    return some != 0


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
    while start < stop and not _is_live(whole, bits, last_b, last_c, bricks, brick_strides, start):
        start += CHUNK
    end = start
    while end < stop and _is_live(whole, bits, last_b, last_c, bricks, brick_strides, end):
        end += CHUNK
    return min(start, stop), min(end, stop)


@compiled(parallel=True)
def forward(
    whole, real, pixel_ptr, order, shape, bits, number, bricks, brick_strides, threads,
    columns, images,
) -> None:  # fmt: skip
    """Add to ``images`` (P,) the projections of a volume.

    Parameters
    ----------
    whole, real : (N, 8) int64, (N, 5) float64
        Courses of rays with one long axis, as `tomo.trace.layers` writes them.
    pixel_ptr : (P + 1,) int64
    order : (P,) int
        In which the pixels are taken: neighbours in the image meet the same voxels.
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
    index, length = number.dtype.type, columns.dtype.type
    pixels = len(images)
    rounds = -(-pixels // (RAYS_TOGETHER * threads))
    room = shape[0] + 1 + CHUNK
    for deal in numba.prange(rounds * threads):
        places = np.zeros(room, number.dtype)
        lengths = np.zeros(2 * room, columns.dtype)
        amid = np.zeros(room, number.dtype)
        corners = np.zeros(room, columns.dtype)
        group = (deal % rounds) * threads + deal // rounds
        for turn in range(group * RAYS_TOGETHER, min((group + 1) * RAYS_TOGETHER, pixels)):
            pixel = order[turn]
            together = 0.0
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                if whole[ray, COUNT] == 0:
                    continue
                course = whole[ray]
                total = length(0)
                line = _line(
                    course, real[ray], bits, last_b, last_c, stride_b, stride_c, index, length
                )
                stop = course[COUNT] + 1
                start, end = _next_run(
                    course, bits, last_b, last_c, bricks, brick_strides, 0, stop
                )
                while start < end:
                    some = _faces(start, end, line, places, lengths, amid, corners)
                    total += dot_pairs(
                        columns, places, lengths, (end - start + CHUNK - 1) & -CHUNK
                    )
                    for k in range(end - start if some else 0):
                        if corners[k] != 0:
                            total += corners[k] * columns[amid[k]]
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
    whole, real, pixel_ptr, order, shape, bits, number, bricks, brick_strides, cuts, own,
    images, columns,
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
    index, length = number.dtype.type, columns.dtype.type
    room = shape[0] + 1 + CHUNK
    for part in numba.prange(len(cuts) - 1):
        low, high = cuts[part], cuts[part + 1]
        places = np.zeros(room, number.dtype)
        lengths = np.zeros(2 * room, columns.dtype)
        amid = np.zeros(room, number.dtype)
        corners = np.zeros(room, columns.dtype)
        for turn in range(len(images) if low < high else 0):
            pixel = order[turn]
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
                line = _line(
                    course, real[ray], bits, last_b, last_c, stride_b, stride_c, index, length
                )
                factor = length(images[pixel] * real[ray, SCALE])
                start, end = _next_run(
                    course, bits, last_b, last_c, bricks, brick_strides, mine & -CHUNK, upto
                )
                while start < end:
                    begin = max(start, mine)
                    some = _faces(begin, end, line, places, lengths, amid, corners)
                    add_pairs(columns, places, lengths, begin, min(end, others) - begin, factor)
                    for k in range(end - begin if some else 0):
                        if corners[k] != 0:
                            row = (amid[k] - 1) // stride_c
                            layer = row // shape[2] if own == 1 else row % shape[2]
                            if low <= layer < high:
                                columns[amid[k]] += corners[k] * factor
                    if end == upto:
                        break
                    start, end = _next_run(
                        course, bits, last_b, last_c, bricks, brick_strides, end, upto
                    )
