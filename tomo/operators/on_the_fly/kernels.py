"""The two products of `tomo.operators.on_the_fly`, whose formulas stand there.

The adjoint adds where the forward product reads. Its numbers ``D`` (`running_sums`) are integers:
they sum exactly in any order, and what cancels leaves zero, not a rounding error.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.operators.on_the_fly.face_crossings import (
    crossings_along_b,
    crossings_along_c,
    lines_of,
    voxel_at,
    voxel_span,
)
from tomo.operators.on_the_fly.ray_setup import ENTER, LEAVE, SCALE

RAYS_TOGETHER = 32
"""Rays whose crossings are found before any sum is read: fewer wait for memory, more leave the
cache."""


@compiled(inline=True)
def _index_at(index, t, slabs):
    """Return the index of ``S[k]`` and ``t - k`` in the column whose ``S[0]`` is at ``index``."""
    slab = min(np.floor(t), slabs - 1.0)
    return np.int64(index + slab), t - slab


@compiled(inline=True)
def _sum_up_to(sums, index, t, slabs):
    """Return ``F(t)`` of the column at ``index``."""
    at, fraction = _index_at(index, t, slabs)
    low = np.float64(sums[np.uint64(at)])
    return low + fraction * (np.float64(sums[np.uint64(at + 1)]) - low)


@compiled(inline=True)
def _between_ends(sums, b, c, span_b, span_c, base, enter, leave, slabs):
    """Return ``F`` where a ray leaves the grid less ``F`` where it enters."""
    last = base + span_b[1] * b[3] + span_c[1] * c[3]
    first = base + span_b[0] * b[3] + span_c[0] * c[3]
    return _sum_up_to(sums, last, leave, slabs) - _sum_up_to(sums, first, enter, slabs)


@compiled(inline=True)
def _lists(index_of, shape, rays):
    """Return room for the crossings of some rays along b and c: indices and fractions."""
    room_b, room_c = rays * shape[1], rays * shape[2]
    return (
        (np.zeros(room_b, index_of.dtype), np.zeros(room_b)),
        (np.zeros(room_c, index_of.dtype), np.zeros(room_c)),
    )


@compiled(inline=True)
def _strides(shape):
    """Return the numbers from one column to the next along b and c."""
    return shape[2] * (shape[0] + 1), shape[0] + 1


@compiled(inline=True)
def _write_crossings(b, c, span_b, span_c, base, lists, at):
    """Write a ray's crossings along b and c from ``at`` on; return their ends."""
    return (
        crossings_along_b(b, span_b, c, span_c, base, *lists[0], at[0]),
        crossings_along_c(c, span_c, b, span_b, base, *lists[1], at[1]),
    )


@compiled(inline=True)
def _differences(sums, indices, fractions, end, stride):
    """Replace each fraction by ``F(t)`` of the lower column less ``F(t)`` of the upper one.

    Differences of float32 are taken in float32: rounding the sums has lost more.
    """
    for m in range(np.uint64(end)):
        i, j = np.uint64(indices[m]), np.uint64(np.int64(indices[m]) + stride)
        low = np.float64(sums[i] - sums[j])
        high = np.float64(sums[i + np.uint64(1)] - sums[j + np.uint64(1)])
        fractions[m] = fractions[m] * (high - low) + low


@compiled(inline=True)
def _read_crossings(sums, lists, end, strides):
    """Replace the fractions of all crossings, see `_differences`."""
    _differences(sums, *lists[0], end[0], strides[0])
    _differences(sums, *lists[1], end[1], strides[1])


@compiled(inline=True, reassociate=True)
def _total(terms, first, end):
    """Return the sum of ``terms[first:end]`` in double precision."""
    total = 0.0
    for m in range(np.uint64(first), np.uint64(end)):
        total += terms[m]
    return total


@compiled()
def forward(parameters, pixel_ptr, shape, index_of, single, double, images) -> None:
    """Write to ``images`` (P,) float64 the projections of a volume.

    ``parameters`` (N, 8) are of rays with one driving axis, `ray_setup`; ``shape`` are voxels
    along a, b, c; ``index_of`` (0,) has the type of indices of running sums. These are ``single``
    or ``double``, the other is empty: one kernel for both types takes half as long to compile as
    two.
    """
    lists, strides = _lists(index_of, shape, RAYS_TOGETHER), _strides(shape)
    ends, signs = np.zeros((RAYS_TOGETHER + 1, 2), np.int64), np.zeros((RAYS_TOGETHER, 2))
    rays, total = np.zeros(RAYS_TOGETHER, np.int64), np.zeros(RAYS_TOGETHER)
    pixel, ray, last_ray = 0, 0, pixel_ptr[len(images)]
    images[:] = 0
    while ray < last_ray:
        some, at = 0, (0, 0)
        while ray < last_ray and some < RAYS_TOGETHER:
            enter, leave = parameters[ray, ENTER], parameters[ray, LEAVE]
            if leave > enter:
                b, c, base = lines_of(parameters, ray, shape)
                span_b = voxel_span(b, enter, leave, shape[1])
                span_c = voxel_span(c, enter, leave, shape[2])
                at = _write_crossings(b, c, span_b, span_c, base, lists, at)
                if len(single) > 0:
                    total[some] = _between_ends(
                        single, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                else:
                    total[some] = _between_ends(
                        double, b, c, span_b, span_c, base, enter, leave, shape[0]
                    )
                signs[some, 0], signs[some, 1], rays[some] = np.sign(b[3]), np.sign(c[3]), ray
                some += 1
                ends[some, 0], ends[some, 1] = at
            ray += 1
        if len(single) > 0:
            _read_crossings(single, lists, at, strides)
        else:
            _read_crossings(double, lists, at, strides)
        for k in range(some):
            sum_b = _total(lists[0][1], ends[k, 0], ends[k + 1, 0])
            sum_c = _total(lists[1][1], ends[k, 1], ends[k + 1, 1])
            value = total[k] + (signs[k, 0] * sum_b + signs[k, 1] * sum_c)
            while rays[k] >= pixel_ptr[pixel + 1]:
                pixel += 1
            images[pixel] += value * parameters[rays[k], SCALE]


@compiled(inline=True)
def _add_at_end(differences, index, t, slabs, whole):
    """Add ``whole`` where `_sum_up_to` reads."""
    at, fraction = _index_at(index, t, slabs)
    upper = np.int64(np.rint(fraction * np.float64(whole)))
    differences[np.uint64(at)] += np.uint64(whole - upper)
    differences[np.uint64(at + 1)] += np.uint64(upper)


@compiled(inline=True)
def _add_crossings(differences, indices, fractions, end, stride, whole):
    """Add ``whole`` to the lower column of each crossing, subtract it from the upper one."""
    scale = np.float64(whole)
    for m in range(np.uint64(end)):
        upper = np.int64(np.rint(fractions[m] * scale))
        low, high = np.uint64(whole - upper), np.uint64(upper)
        i, j = np.uint64(indices[m]), np.uint64(np.int64(indices[m]) + stride)
        differences[i] += low
        differences[i + np.uint64(1)] += high
        differences[j] -= low
        differences[j + np.uint64(1)] -= high


@compiled(inline=True)
def _clipped(b, c, enter, leave, span_b, span_c, low, high):
    """Return the part of a ray in the columns ``low:high`` along b, which is one piece."""
    first_b, last_b = span_b
    first_c, last_c = span_c
    if first_b < low:
        first_b, enter = low, (low - b[0]) * b[2]
        first_c = min(max(voxel_at(c, enter, False), first_c), last_c)
    if last_b >= high:
        last_b, leave = high - 1.0, (high - b[0]) * b[2]
        last_c = min(max(voxel_at(c, leave, False), first_c), last_c)
    return enter, leave, (first_b, last_b), (first_c, last_c)


@compiled()
def adjoint(
    parameters, pixel_ptr, shape, index_of, first_b, end_b, per_unit, images, differences
) -> None:  # fmt: skip
    """Add to ``differences`` the transpose of `forward` for ``images`` (P,).

    uint64 in units of ``1 / per_unit``, negative numbers as their complement, of the columns
    ``first_b`` to ``end_b``, the last excluded.
    """
    first_column = float(first_b * shape[2] * (shape[0] + 1))
    lists, strides = _lists(index_of, shape, 1), _strides(shape)
    for pixel in range(len(images)):
        for ray in range(pixel_ptr[pixel], pixel_ptr[pixel + 1] if images[pixel] != 0 else 0):
            enter, leave = parameters[ray, ENTER], parameters[ray, LEAVE]
            if not leave > enter:
                continue
            b, c, base = lines_of(parameters, ray, shape)
            low, high = float(first_b), float(end_b)
            span_b = voxel_span(b, enter, leave, shape[1])
            if b[3] < 0:
                low, high = shape[1] - high, shape[1] - low
            if span_b[0] >= high or span_b[1] < low:
                continue
            span_c = voxel_span(c, enter, leave, shape[2])
            if span_b[0] < low or span_b[1] >= high:
                enter, leave, span_b, span_c = _clipped(
                    b, c, enter, leave, span_b, span_c, low, high
                )
            base -= first_column
            whole = np.int64(np.floor(images[pixel] * parameters[ray, SCALE] * per_unit + 0.5))
            index = base + span_b[1] * b[3] + span_c[1] * c[3]
            _add_at_end(differences, index, leave, shape[0], whole)
            index = base + span_b[0] * b[3] + span_c[0] * c[3]
            _add_at_end(differences, index, enter, shape[0], -whole)
            end = _write_crossings(b, c, span_b, span_c, base, lists, (0, 0))
            whole_b = -whole if b[3] < 0 else whole
            whole_c = -whole if c[3] < 0 else whole
            _add_crossings(differences, *lists[0], end[0], strides[0], whole_b)
            _add_crossings(differences, *lists[1], end[1], strides[1], whole_c)
