"""Project through running sums, with no stored matrix: work only where a ray changes its column.

With the running sums ``S`` of a column (`tomo.trace.columns`), linear between layers,
``F(t) = S[k] + (t - k) (S[k + 1] - S[k])`` with ``k = floor(t)``, a ray that is in the column from
``t0`` to ``t1`` along the long axis passes ``F(t1) - F(t0)``: the sum of all its voxels there,
each times the exact length in it. So the sum along a ray is ``F`` of its last column where it
leaves the grid, less ``F`` of its first where it enters, and at each change of column in between
(`tomo.trace._changes`) ``F`` of the column left less that of the one entered.

The adjoint adds a pixel's value where the forward takes ``S``, to numbers that
`tomo.trace.columns` sums up to voxels. They are whole numbers: sums are exact, in any order, and a
column's share above the last voxel that a ray met is zero, not a rounding error.
"""

from __future__ import annotations

import numpy as np

from tomo._compile import compiled
from tomo.trace._changes import LANES, changes, lines, passed, voxels, within
from tomo.trace._pairs import add_pairs, between_pairs, prefetch_pairs, subtract_pairs
from tomo.trace.courses import ENTER, LEAVE, SCALE

FIRST, MIDDLE, END, STEP_B, STEP_C = range(5)
"""Where a ray's changes along b begin, those along c begin, and these end; and how much farther
than the column that is left that entered stands, along b and along c."""

RAYS_AHEAD = 16
"""Rays whose places are computed before they are read: memory takes longer than one ray."""


@compiled(inline=True)
def _sum_up_to(sums, place, t, layers):
    """Return ``F(t)`` of the column at ``place``."""
    at, part = within(place, t, layers)
    low = np.float64(sums[np.uint64(at)])
    return low + part * (np.float64(sums[np.uint64(at + 1)]) - low)


@compiled(inline=True)
def _between_ends(sums, b, c, span_b, span_c, base, enter, leave, layers):
    """Return ``F`` where a ray leaves the grid less ``F`` where it enters."""
    last = base + span_b[1] * b[3] + span_c[1] * c[3]
    first = base + span_b[0] * b[3] + span_c[0] * c[3]
    return _sum_up_to(sums, last, leave, layers) - _sum_up_to(sums, first, enter, layers)


@compiled(inline=True)
def _write_changes(b, c, span_b, span_c, base, at, left, parts, ways, k):
    """Write ray ``k``'s changes of column from ``at`` on, and where they are; return their end."""
    middle = changes(b, *span_b, c, *span_c, base, True, at, left, parts)
    end = changes(c, *span_c, b, *span_b, base, False, middle, left, parts)
    ways[k, FIRST], ways[k, MIDDLE], ways[k, END] = at, middle, end
    ways[k, STEP_B], ways[k, STEP_C] = int(b[3]), int(c[3])
    return end


@compiled(inline=True)
def _between(sums, left, parts, ways, k):
    """Return the sum over the changes of ray ``k``, those along b and those along c."""
    return between_pairs(
        sums, left, ways[k, STEP_B], parts, ways[k, FIRST], ways[k, MIDDLE]
    ) + between_pairs(sums, left, ways[k, STEP_C], parts, ways[k, MIDDLE], ways[k, END])


@compiled(inline=True)
def _prefetch(sums, left, ways, k):
    """Have fetched what `_between` is going to read."""
    prefetch_pairs(sums, left, ways[k, STEP_B], ways[k, FIRST], ways[k, MIDDLE])
    prefetch_pairs(sums, left, ways[k, STEP_C], ways[k, MIDDLE], ways[k, END])


@compiled()
def forward(courses, pixel_ptr, shape, number, single, double, images) -> None:
    """Write to ``images`` (P,) the projections of a volume.

    Parameters
    ----------
    courses : (N, 8) float64
        Courses of rays with one long axis, as `tomo.trace.courses` writes them.
    pixel_ptr : (P + 1,) int64
    shape : (3,) int
        Voxels along the axes a, b, c.
    number : (0,) int32 or int64
        Of which type places are.
    single, double : float32, float64
        Running sums of the volume, column by column, in one of them; the other is empty. One
        kernel for both types takes half as long to compile as two.
    images : (P,) float64
    """
    room = RAYS_AHEAD * (shape[1] + shape[2]) + LANES
    left, parts = np.zeros(room, number.dtype), np.zeros(room)
    ways = np.zeros((RAYS_AHEAD, 5), np.int64)
    along, rays = np.zeros(RAYS_AHEAD), np.zeros(RAYS_AHEAD, np.int64)
    pixel, ray, last_ray = 0, 0, pixel_ptr[len(images)]
    images[:] = 0
    while ray < last_ray:
        some, at = 0, 0
        while ray < last_ray and some < RAYS_AHEAD:
            enter, leave = courses[ray, ENTER], courses[ray, LEAVE]
            if leave > enter:
                b, c, base = lines(courses, ray, shape)
                span_b = voxels(b, enter, leave, shape[1])
                span_c = voxels(c, enter, leave, shape[2])
                first = at
                at = _write_changes(b, c, span_b, span_c, base, first, left, parts, ways, some)
                if len(single) > 0:
                    _prefetch(single, left, ways, some)
                    along[some] = _between_ends(
                        single, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                else:
                    _prefetch(double, left, ways, some)
                    along[some] = _between_ends(
                        double, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                rays[some] = ray
                some += 1
            ray += 1
        for k in range(some):
            if len(single) > 0:
                total = along[k] + _between(single, left, parts, ways, k)
            else:
                total = along[k] + _between(double, left, parts, ways, k)
            while rays[k] >= pixel_ptr[pixel + 1]:
                pixel += 1
            images[pixel] += total * courses[rays[k], SCALE]


@compiled(inline=True)
def _add_up_to(differences, place, t, layers, whole):
    """Add ``whole`` where `_sum_up_to` reads."""
    at, part = within(place, t, layers)
    share = np.int64(np.floor(part * np.float64(whole) + 0.5))
    differences[np.uint64(at)] += np.uint64(whole - share)
    differences[np.uint64(at + 1)] += np.uint64(share)


@compiled(inline=True)
def _add_ways(differences, left, shares, ways, wholes, rays):
    """Add what rays bring at their changes to the columns left, subtract it from those entered.

    One after the other: a processor that must read in one part what it has just written in two
    waits for it, and the next change is near to where this one enters.
    """
    for k in range(rays):
        first, middle, end, whole = ways[k, FIRST], ways[k, MIDDLE], ways[k, END], wholes[k]
        add_pairs(differences, left, shares, first, end, whole)
        subtract_pairs(differences, left, ways[k, STEP_B], shares, first, middle, whole)
        subtract_pairs(differences, left, ways[k, STEP_C], shares, middle, end, whole)


@compiled(inline=True)
def _clipped(b, c, enter, leave, span_b, span_c, low, high):
    """Return the part of a ray's way, which is one piece, in the columns ``low:high`` along b."""
    first_b, last_b = span_b
    first_c, last_c = span_c
    if first_b < low:
        first_b, enter = low, (low - b[0]) * b[2]
        first_c = min(max(passed(c, enter, False), first_c), last_c)
    if last_b >= high:
        last_b, leave = high - 1.0, (high - b[0]) * b[2]
        last_c = min(max(passed(c, leave, False), first_c), last_c)
    return enter, leave, (first_b, last_b), (first_c, last_c)


@compiled()
def adjoint(
    courses, pixel_ptr, shape, number, first_b, end_b, per_unit, images, differences
) -> tuple[int, int]:  # fmt: skip
    """Add to ``differences`` the transpose of `forward` for ``images`` (P,).

    ``differences`` (uint64, wrapping around) have the columns from ``first_b`` to before ``end_b``
    of axis b, in whole numbers of which there are ``per_unit`` to one; ``images`` are float64.
    Other parameters as in `forward`. Returns the first and the last column along b that rays of
    pixels other than zero meet, in that range or not; the first is beyond the last if none do.
    """
    lowest, highest = float(shape[1]), -1.0
    first_column = float(first_b * shape[2] * (shape[0] + 1))
    room = RAYS_AHEAD * (shape[1] + shape[2]) + LANES
    left, parts, shares = np.zeros(room, number.dtype), np.zeros(room), np.zeros(room, np.int64)
    ways, wholes = np.zeros((RAYS_AHEAD, 5), np.int64), np.zeros(RAYS_AHEAD, np.int64)
    some, at = 0, 0
    for pixel in range(len(images)):
        for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1] if images[pixel] != 0 else 0):
            enter, leave = courses[ray, ENTER], courses[ray, LEAVE]
            if not leave > enter:
                continue
            b, c, base = lines(courses, ray, shape)
            low, high = float(first_b), float(end_b)
            span_b = voxels(b, enter, leave, shape[1])
            if b[3] < 0:
                low, high = shape[1] - high, shape[1] - low
                lowest = min(lowest, shape[1] - 1 - span_b[1])
                highest = max(highest, shape[1] - 1 - span_b[0])
            else:
                lowest, highest = min(lowest, span_b[0]), max(highest, span_b[1])
            if span_b[0] >= high or span_b[1] < low:
                continue
            span_c = voxels(c, enter, leave, shape[2])
            if span_b[0] < low or span_b[1] >= high:
                enter, leave, span_b, span_c = _clipped(
                    b, c, enter, leave, span_b, span_c, low, high
                )
            base -= first_column
            whole = np.int64(np.floor(images[pixel] * courses[ray, SCALE] * per_unit + 0.5))
            place = base + span_b[1] * b[3] + span_c[1] * c[3]
            _add_up_to(differences, place, leave, shape[0], whole)
            place = base + span_b[0] * b[3] + span_c[0] * c[3]
            _add_up_to(differences, place, enter, shape[0], -whole)
            first = at
            at = _write_changes(b, c, span_b, span_c, base, first, left, parts, ways, some)
            _prefetch(differences, left, ways, some)
            for m in range(first, first + ((at - first + LANES - 1) & -LANES)):
                shares[np.uint64(m)] = np.int64(
                    np.floor(parts[np.uint64(m)] * np.float64(whole) + 0.5)
                )
            wholes[some] = whole
            some += 1
            if some == RAYS_AHEAD:
                _add_ways(differences, left, shares, ways, wholes, some)
                some, at = 0, 0
    _add_ways(differences, left, shares, ways, wholes, some)
    return int(lowest), int(highest)
