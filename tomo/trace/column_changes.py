"""Project through running sums, with no stored matrix: work only where a ray changes its column.

With the running sums ``S`` of a column (`tomo.trace.columns`), linear between layers,
``F(t) = S[k] + (t - k) (S[k + 1] - S[k])`` with ``k = floor(t)``, a ray that is in the column from
``t0`` to ``t1`` along the long axis passes ``F(t1) - F(t0)``: the sum of all its voxels there,
each times the exact length in it. So the sum along a ray is ``F`` of its last column where it
leaves the grid, less ``F`` of its first where it enters, and at each change of column in between
``F`` of the column left less that of the one entered. No work is done for layers passed inside a
column.

A ray passes the planes between columns along b at ``t(i) = (i - start) / slope`` and likewise
along c: two regular families, in one loop that vectorises. Where a plane of one is passed, the
ray's place along the other is a count of that one's planes passed before. Both counts compare the
same two numbers ``t``, planes of c first where they are equal: so there is one order of all
changes, and the sums of columns that are entered and left cancel.

The adjoint adds a pixel's value where the forward takes ``S``, to numbers that
`tomo.trace.columns` sums up to voxels. They are whole numbers: sums are exact, in any order, and a
column's share above the last voxel that a ray met is zero, not a rounding error. Each part has the
columns of a range along b, in which a ray's way is one piece, so that nothing is written twice at
a time.
"""

from __future__ import annotations

import numba
import numpy as np

from tomo._compile import compiled
from tomo.trace._pairs import CHAINS, add_pairs, between_pairs, prefetch, subtract_pairs
from tomo.trace.courses import ENTER, LEAVE, SCALE, SLOPE_B, SLOPE_C, START_B, START_C

RAYS_TOGETHER = 256  # pixels that a thread takes at a time

RAYS_AHEAD = 16
"""Rays whose places are computed before they are read: memory takes longer than one ray."""

_LANES = 16  # changes that are computed together; those beyond the last are not used


@compiled(inline=True)
def _line(course, shape):
    """Return what the changes of a ray need: a pair of lines and the strides along them."""
    stride_c = float(shape[0] + 1)
    stride_b = stride_c * shape[2]
    slope_b, slope_c, base = course[SLOPE_B], course[SLOPE_C], 0.0
    if slope_b < 0:
        base += (shape[1] - 1) * stride_b
        slope_b, stride_b = -slope_b, -stride_b
    if slope_c < 0:
        base += (shape[2] - 1) * stride_c
        slope_c, stride_c = -slope_c, -stride_c
    per_b = 1.0 / slope_b if slope_b > 0 else 0.0
    per_c = 1.0 / slope_c if slope_c > 0 else 0.0
    return (
        (course[START_B], slope_b, per_b, stride_b), (course[START_C], slope_c, per_c, stride_c),
        base,
    )  # fmt: skip


@compiled(inline=True)
def _passed(axis, t, before):
    """Return how many planes a ray passed up to ``t``, or before it: the voxel it is in.

    The nearest plane is the only one in doubt.
    """
    start, slope, per, _ = axis
    if slope == 0:
        return np.floor(start)
    nearest = np.floor(start + slope * t + 0.5)
    at = (nearest - start) * per
    return nearest - (at >= t if before else at > t)


@compiled(inline=True)
def _voxels(axis, enter, leave, count):
    """Return the first and the last voxel that a ray is in along b or c."""
    first = min(max(_passed(axis, enter, False), 0.0), count - 1.0)
    return first, min(max(_passed(axis, leave, True), first), count - 1.0)


@compiled(inline=True)
def _changes(b, c, first_b, last_b, first_c, last_c, base, left, entered, parts):
    """Write a ray's changes of column, those along b first, and return how many there are.

    Parameters
    ----------
    b, c : (start, slope, layers a voxel, stride)
        The ray along both axes.
    first_b, last_b, first_c, last_c : float64
        Voxels between which it is.
    base : float64
    left, entered : (changes + 15,) int32 or int64
        Written: the places of ``S[k]`` in the column that is left and in the one entered.
    parts : float64
        Written: ``t - k``.
    """
    index = left.dtype.type
    along_b = last_b - first_b
    count = int(along_b + (last_c - first_c))
    for m in range((count + _LANES - 1) & -_LANES):
        number = float(m)
        is_b = number < along_b
        plane = first_b + 1.0 + number if is_b else first_c + 1.0 + (number - along_b)
        start, per, stride = (
            b[0] if is_b else c[0], b[2] if is_b else c[2], b[3] if is_b else c[3]
        )  # fmt: skip
        other, slope, other_per, other_stride = (
            c[0] if is_b else b[0], c[1] if is_b else b[1], c[2] if is_b else b[2],
            c[3] if is_b else b[3],
        )  # fmt: skip
        low, high = (first_c if is_b else first_b), (last_c if is_b else last_b)
        t = (plane - start) * per
        layer = np.floor(t)
        nearest = np.floor(other + slope * t + 0.5)
        at = (nearest - other) * other_per
        after = (at > t) | ((at == t) & (not is_b))
        voxel = min(max(nearest - (1.0 if after else 0.0), low), high)
        place = base + (plane - 1.0) * stride + voxel * other_stride + layer
        left[m] = index(place)
        entered[m] = index(place + stride)
        parts[m] = t - layer
    return count


@compiled(inline=True)
def _within(place, t, layers):
    """Return the place of ``S[k]`` and ``t - k`` at an end of a ray."""
    layer = min(np.floor(t), layers - 1.0)
    return np.int64(place + layer), t - layer


@compiled(inline=True)
def _ways(course, shape, nowhere, left, entered, parts):
    """Write where a ray reads running sums, and return how often: a multiple of `CHAINS`.

    Where it leaves the grid nothing is entered and the other way round; ``nowhere`` is the place
    of a pair of zeros. Other parameters as in `_changes`.
    """
    index = left.dtype.type
    enter, leave = course[ENTER], course[LEAVE]
    b, c, base = _line(course, shape)
    first_b, last_b = _voxels(b, enter, leave, shape[1])
    first_c, last_c = _voxels(c, enter, leave, shape[2])
    at, parts[0] = _within(base + last_b * b[3] + last_c * c[3], leave, shape[0])
    left[0], entered[0] = index(at), index(nowhere)
    at, parts[1] = _within(base + first_b * b[3] + first_c * c[3], enter, shape[0])
    left[1], entered[1] = index(nowhere), index(at)
    count = 2 + _changes(
        b, c, first_b, last_b, first_c, last_c, base, left[2:], entered[2:], parts[2:]
    )
    for m in range(CHAINS):
        left[count + m], entered[count + m] = index(nowhere), index(nowhere)
    return (count + CHAINS - 1) & -CHAINS


@compiled(parallel=True)
def forward(courses, pixel_ptr, shape, number, threads, single, double, images) -> None:
    """Add to ``images`` (P,) the projections of a volume.

    Parameters
    ----------
    courses : (N, 8) float64
        Courses of rays with one long axis, as `tomo.trace.courses` writes them.
    pixel_ptr : (P + 1,) int64
    shape : (3,) int
        Voxels along the axes a, b, c.
    number : (0,) int32 or int64
        Of which type places are.
    threads : int
        Between which the pixels are dealt out in turn.
    single, double : float32, float64
        Running sums of the volume, column by column, in one of them; the other is empty. One
        kernel for both types takes half as long to compile as two.
    images : (P,) float64
    """
    pixels, nowhere = len(images), max(len(single), len(double)) - 2
    rounds = -(-pixels // (RAYS_TOGETHER * threads))
    room = RAYS_AHEAD * (shape[1] + shape[2] + CHAINS) + _LANES
    along = np.zeros(len(courses))
    for deal in numba.prange(rounds * threads):
        left, entered = np.zeros(room, number.dtype), np.zeros(room, number.dtype)
        parts = np.zeros(room)
        ends, numbers = np.zeros(RAYS_AHEAD + 1, np.int64), np.zeros(RAYS_AHEAD, np.int64)
        group = (deal % rounds) * threads + deal // rounds
        first = min(group * RAYS_TOGETHER, pixels)
        last = min(first + RAYS_TOGETHER, pixels)
        ray, stop = pixel_ptr[first], pixel_ptr[last]
        while ray < stop:
            some = 0
            while ray < stop and some < RAYS_AHEAD:
                if courses[ray, LEAVE] > courses[ray, ENTER]:
                    at = ends[some]
                    count = _ways(
                        courses[ray], shape, nowhere, left[at:], entered[at:], parts[at:]
                    )
                    if len(single) > 0:
                        prefetch(single, left[at:], entered[at:], count)
                    else:
                        prefetch(double, left[at:], entered[at:], count)
                    numbers[some] = ray
                    some += 1
                    ends[some] = at + count
                ray += 1
            for k in range(some):
                at = ends[k]
                count = ends[k + 1] - at
                if len(single) > 0:
                    total = between_pairs(single, left[at:], entered[at:], parts[at:], count)
                else:
                    total = between_pairs(double, left[at:], entered[at:], parts[at:], count)
                along[numbers[k]] = total * courses[numbers[k], SCALE]
        for pixel in range(first, last):
            together = 0.0
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                together += along[ray]
            images[pixel] += together


@compiled(inline=True)
def _add_at(differences, place, t, layers, whole, sign):
    """Add ``sign`` times ``whole`` at ``t`` to the column at ``place``."""
    at, part = _within(place, t, layers)
    share = np.int64(np.floor(part * whole + 0.5))
    differences[at] += np.uint64(sign * (np.int64(whole) - share))
    differences[at + 1] += np.uint64(sign * share)


@compiled(inline=True)
def _add_ways(differences, left, entered, shares, ends, wholes, rays):
    """Add what rays bring at their changes to the columns left, subtract it from those entered.

    One after the other: a processor that must read in one part what it has just written in two
    waits for it, and the next change is near to where this one enters.
    """
    for k in range(rays):
        at, count = ends[k], ends[k + 1] - ends[k]
        add_pairs(differences, left[at:], shares[at:], count, wholes[k])
        subtract_pairs(differences, entered[at:], shares[at:], count, wholes[k])


@compiled(parallel=True)
def adjoint(courses, pixel_ptr, shape, number, cuts, per_unit, images, differences) -> None:
    """Add to ``differences`` the transpose of `forward` for ``images`` (P,).

    Part ``p`` has the columns from ``cuts[p]`` to ``cuts[p + 1]`` of axis b; ``differences``
    (uint64, wrapping around) begins with those from ``cuts[0]`` on, in whole numbers of which
    there are ``per_unit`` to one; ``images`` are float64. Other parameters as in `forward`.
    """
    first_column = float(cuts[0] * shape[2] * (shape[0] + 1))
    room = RAYS_AHEAD * (shape[1] + shape[2]) + _LANES
    for part in numba.prange(len(cuts) - 1):
        left, entered = np.zeros(room, number.dtype), np.zeros(room, number.dtype)
        parts, shares = np.zeros(room), np.zeros(room, np.int64)
        ends, wholes = np.zeros(RAYS_AHEAD + 1, np.int64), np.zeros(RAYS_AHEAD, np.int64)
        some = np.int64(0)
        for pixel in range(len(images) if cuts[part] < cuts[part + 1] else 0):
            if images[pixel] == 0:
                continue
            for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1]):
                course = courses[ray]
                enter, leave = course[ENTER], course[LEAVE]
                if not leave > enter:
                    continue
                b, c, base = _line(course, shape)
                low, high = float(cuts[part]), float(cuts[part + 1])
                if b[3] < 0:
                    low, high = shape[1] - high, shape[1] - low
                first_b, last_b = _voxels(b, enter, leave, shape[1])
                if first_b >= high or last_b < low:
                    continue
                first_c, last_c = _voxels(c, enter, leave, shape[2])
                if first_b < low:
                    first_b, enter = low, (low - b[0]) * b[2]
                    first_c = min(max(_passed(c, enter, False), first_c), last_c)
                if last_b >= high:
                    last_b, leave = high - 1.0, (high - b[0]) * b[2]
                    last_c = min(max(_passed(c, leave, False), first_c), last_c)
                base -= first_column
                whole = np.floor(images[pixel] * course[SCALE] * per_unit + 0.5)
                place = base + last_b * b[3] + last_c * c[3]
                _add_at(differences, place, leave, shape[0], whole, 1)
                place = base + first_b * b[3] + first_c * c[3]
                _add_at(differences, place, enter, shape[0], whole, -1)
                at = ends[some]
                count = _changes(
                    b, c, first_b, last_b, first_c, last_c, base, left[at:], entered[at:], parts
                )
                prefetch(differences, left[at:], entered[at:], count)
                mine = shares[at:]
                for m in range((count + _LANES - 1) & -_LANES):
                    mine[m] = np.int64(np.floor(parts[m] * whole + 0.5))
                wholes[some] = np.int64(whole)
                some += 1
                ends[some] = at + count
                if some == RAYS_AHEAD:
                    _add_ways(differences, left, entered, shares, ends, wholes, some)
                    some = np.int64(0)
        _add_ways(differences, left, entered, shares, ends, wholes, some)
