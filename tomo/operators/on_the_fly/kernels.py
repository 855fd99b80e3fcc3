"""Project through running sums, with no stored matrix: work only where a ray changes its column.

With the running sums ``S`` of a column (`tomo.operators.on_the_fly.running_sums`), linear between
layers, ``F(t) = S[k] + (t - k) (S[k + 1] - S[k])`` with ``k = floor(t)``, a ray that is in the
column from ``t0`` to ``t1`` along the long axis passes ``F(t1) - F(t0)``: the sum of all its
voxels there, each times the exact length in it. So the sum along a ray is ``F`` of its last column
where it leaves the grid, less ``F`` of its first where it enters, and at each change of column in
between (`tomo.operators.on_the_fly._face_crossings`) ``F`` of the column left less that of the one
entered.

The adjoint adds a pixel's value where the forward takes ``S``, to numbers that
`tomo.operators.on_the_fly.running_sums` sums up to voxels. They are whole numbers: sums are exact,
in any order, and a column's share above the last voxel that a ray met is zero, not a rounding
error.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.operators.on_the_fly._face_crossings import (
    changes_of_b,
    changes_of_c,
    lines,
    passed,
    voxels,
    within,
)
from tomo.operators.on_the_fly.ray_setup import ENTER, LEAVE, SCALE

RAYS_TOGETHER = 32
"""Rays whose changes are all found before what they pass there is read."""


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
def _lists(number, shape, rays):
    """Return room for the changes of some rays along b and c: places of sums, parts of a layer."""
    room_b, room_c = rays * shape[1], rays * shape[2]
    return (
        (np.zeros(room_b, number.dtype), np.zeros(room_b)),
        (np.zeros(room_c, number.dtype), np.zeros(room_c)),
    )


@compiled(inline=True)
def _strides(shape):
    """Return how many places there are from one column to the next along b and c."""
    return shape[2] * (shape[0] + 1), shape[0] + 1


@compiled(inline=True)
def _write_changes(b, c, span_b, span_c, base, lists, at):
    """Write a ray's changes along b and c from ``at`` on; return their ends."""
    return (
        changes_of_b(b, span_b, c, span_c, base, *lists[0], at[0]),
        changes_of_c(c, span_c, b, span_b, base, *lists[1], at[1]),
    )


@compiled(inline=True)
def _between(sums, places, parts, end, step):
    """Replace each part ``t - k`` of the lower column by ``F(t)`` there less that in the upper.

    Differences of single numbers are taken as such: they lose nothing that the numbers' own
    rounding has left.
    """
    for m in range(np.uint64(end)):
        i, j = np.uint64(places[m]), np.uint64(np.int64(places[m]) + step)
        low = np.float64(sums[i] - sums[j])
        high = np.float64(sums[i + np.uint64(1)] - sums[j + np.uint64(1)])
        parts[m] = parts[m] * (high - low) + low


@compiled(inline=True)
def _read_changes(sums, lists, end, strides):
    """Put differences where the parts of layers stand."""
    _between(sums, *lists[0], end[0], strides[0])
    _between(sums, *lists[1], end[1], strides[1])


@compiled(inline=True, reassociate=True)
def _total(terms, first, end):
    """Return the sum of ``terms[first:end]``, taken in vectors: in an order of its own."""
    total = 0.0
    for m in range(np.uint64(first), np.uint64(end)):
        total += terms[m]
    return total


@compiled()
def forward(courses, pixel_ptr, shape, number, single, double, images) -> None:
    """Write to ``images`` (P,) the projections of a volume.

    Parameters
    ----------
    courses : (N, 8) float64
        Courses of rays with one long axis, as `tomo.operators.on_the_fly.ray_setup` writes them.
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
    lists, strides = _lists(number, shape, RAYS_TOGETHER), _strides(shape)
    ends, signs = np.zeros((RAYS_TOGETHER + 1, 2), np.int64), np.zeros((RAYS_TOGETHER, 2))
    rays, total = np.zeros(RAYS_TOGETHER, np.int64), np.zeros(RAYS_TOGETHER)
    pixel, ray, last_ray = 0, 0, pixel_ptr[len(images)]
    images[:] = 0
    while ray < last_ray:
        some, at = 0, (0, 0)
        while ray < last_ray and some < RAYS_TOGETHER:
            enter, leave = courses[ray, ENTER], courses[ray, LEAVE]
            if leave > enter:
                b, c, base = lines(courses, ray, shape)
                span_b = voxels(b, enter, leave, shape[1])
                span_c = voxels(c, enter, leave, shape[2])
                end = _write_changes(b, c, span_b, span_c, base, lists, at)
                if len(single) > 0:
                    total[some] = _between_ends(
                        single, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                else:
                    total[some] = _between_ends(
                        double, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                signs[some, 0], signs[some, 1], rays[some] = np.sign(b[3]), np.sign(c[3]), ray
                at, some = end, some + 1
                ends[some, 0], ends[some, 1] = at
            ray += 1
        if len(single) > 0:
            _read_changes(single, lists, at, strides)
        else:
            _read_changes(double, lists, at, strides)
        for k in range(some):
            sum_b = _total(lists[0][1], ends[k, 0], ends[k + 1, 0])
            sum_c = _total(lists[1][1], ends[k, 1], ends[k + 1, 1])
            value = total[k] + (signs[k, 0] * sum_b + signs[k, 1] * sum_c)
            while rays[k] >= pixel_ptr[pixel + 1]:
                pixel += 1
            images[pixel] += value * courses[rays[k], SCALE]


@compiled(inline=True)
def _add_up_to(differences, place, t, layers, whole):
    """Add ``whole`` where `_sum_up_to` reads."""
    at, part = within(place, t, layers)
    share = np.int64(np.rint(part * np.float64(whole)))
    differences[np.uint64(at)] += np.uint64(whole - share)
    differences[np.uint64(at + 1)] += np.uint64(share)


@compiled(inline=True)
def _add_changes(differences, places, parts, end, step, whole):
    """Add what a ray brings at its changes to the lower columns, subtract it from the upper."""
    scale = np.float64(whole)
    for m in range(np.uint64(end)):
        share = np.int64(np.rint(parts[m] * scale))
        low, high = np.uint64(whole - share), np.uint64(share)
        i, j = np.uint64(places[m]), np.uint64(np.int64(places[m]) + step)
        differences[i] += low
        differences[i + np.uint64(1)] += high
        differences[j] -= low
        differences[j + np.uint64(1)] -= high


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
) -> None:  # fmt: skip
    """Add to ``differences`` the transpose of `forward` for ``images`` (P,).

    ``differences`` (uint64, wrapping around) have the columns from ``first_b`` to before ``end_b``
    of axis b, in whole numbers of which there are ``per_unit`` to one; ``images`` are float64.
    Other parameters as in `forward`.
    """
    first_column = float(first_b * shape[2] * (shape[0] + 1))
    lists, strides = _lists(number, shape, 1), _strides(shape)
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
            end = _write_changes(b, c, span_b, span_c, base, lists, (0, 0))
            whole_b = -whole if b[3] < 0 else whole
            whole_c = -whole if c[3] < 0 else whole
            _add_changes(differences, *lists[0], end[0], strides[0], whole_b)
            _add_changes(differences, *lists[1], end[1], strides[1], whole_c)
