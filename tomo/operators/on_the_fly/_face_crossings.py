"""Where a ray changes its column, and at which layer: no work for layers passed inside a column.

A ray passes the planes between columns along b at ``t(i) = (i - start) / slope`` and likewise
along c: two regular families. Where a plane of one is passed, the ray's place along the other is a
count of that one's planes passed before. Both counts compare the same two numbers ``t``, planes of
c first where they are equal: so there is one order of all changes, and the running sums of columns
that are entered and left cancel.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.operators.on_the_fly.ray_setup import SLOPE_B, SLOPE_C, START_B, START_C


@compiled(inline=True)
def lines(courses, ray, shape):
    """Return what the changes of a ray need: its lines along b and c, and a first place.

    A line is ``(start, slope, layers a voxel, stride)``. The place of ``S[k]`` in column
    ``(b, c)``, both counted as the course counts them, is that first one plus ``b`` and ``c``
    times the strides, plus ``k``.
    """
    stride_c = float(shape[0] + 1)
    stride_b = stride_c * shape[2]
    slope_b, slope_c, base = courses[ray, SLOPE_B], courses[ray, SLOPE_C], 0.0
    if slope_b < 0:
        base += (shape[1] - 1) * stride_b
        slope_b, stride_b = -slope_b, -stride_b
    if slope_c < 0:
        base += (shape[2] - 1) * stride_c
        slope_c, stride_c = -slope_c, -stride_c
    per_b = 1.0 / slope_b if slope_b > 0 else 0.0
    per_c = 1.0 / slope_c if slope_c > 0 else 0.0
    return (
        (courses[ray, START_B], slope_b, per_b, stride_b),
        (courses[ray, START_C], slope_c, per_c, stride_c),
        base,
    )


@compiled(inline=True)
def passed(line, t, before):
    """Return how many planes a ray passed up to ``t``, or before it: the voxel it is in.

    The nearest plane is the only one in doubt.
    """
    start, slope, per, _ = line
    if slope == 0:
        return np.floor(start)
    nearest = np.floor(start + slope * t + 0.5)
    at = (nearest - start) * per
    return nearest - (at >= t if before else at > t)


@compiled(inline=True)
def voxels(line, enter, leave, count):
    """Return the first and the last voxel that a ray is in along b or c."""
    first = min(max(passed(line, enter, False), 0.0), count - 1.0)
    return first, min(max(passed(line, leave, True), first), count - 1.0)


@compiled(inline=True)
def within(place, t, layers):
    """Return the place of ``S[k]`` and ``t - k`` at an end of a ray."""
    layer = min(np.floor(t), layers - 1.0)
    return np.int64(place + layer), t - layer


@compiled(inline=True)
def _changes(other_is_before, own, span, other, other_span, base, places, parts, at):
    """Write the changes of column along one axis; see `changes_of_b`."""
    start, _, per, stride = own
    to, slope, of, across = other
    lowest, highest = other_span
    first, last = span
    count = np.int64(last - first)
    # the lower of two columns: where the axis is mirrored, that which is entered
    line = base + first * stride + (stride if stride < 0 else 0.0)
    for m in range(count):
        t = (first + 1.0 + m - start) * per
        layer = np.floor(t)
        nearest = np.rint(t * slope + to)
        there = (nearest - to) * of
        ahead = there > t if other_is_before else there >= t
        voxel = nearest - 1.0 if ahead else nearest
        voxel = lowest if voxel < lowest else voxel
        voxel = highest if highest < voxel else voxel
        here = np.uint64(at + m)
        places[here] = np.int64(voxel * across + (line + m * stride + layer))
        parts[here] = t - layer
    return at + count


@compiled(inline=True)
def changes_of_b(own, span, other, other_span, base, places, parts, at):
    """Write the changes of column along b from ``at`` on, and return their end.

    Parameters
    ----------
    own, other : (start, slope, layers a voxel, stride)
        The line along the axis, and that along the other one.
    span, other_span : (float64, float64)
        Voxels along them between which the ray is.
    base : float64
    places : (end or more,) int32 or int64
        Written: the place of ``S[k]`` in the lower of the two columns; that in the upper one is a
        stride on.
    parts : (end or more,) float64
        Written: ``t - k``.
    at : int
    """
    return _changes(True, own, span, other, other_span, base, places, parts, at)


@compiled(inline=True)
def changes_of_c(own, span, other, other_span, base, places, parts, at):
    """Write the changes of column along c; see `changes_of_b`."""
    return _changes(False, own, span, other, other_span, base, places, parts, at)
