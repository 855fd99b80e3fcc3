"""Where a ray changes its column, and at which layer: no work for layers passed inside a column.

A ray passes the planes between columns along b at ``t(i) = (i - start) / slope`` and likewise
along c: two regular families. Where a plane of one is passed, the ray's place along the other is a
count of that one's planes passed before. Both counts compare the same two numbers ``t``, planes of
c first where they are equal: so there is one order of all changes, and the running sums of columns
that are entered and left cancel.
"""

from __future__ import annotations

import numpy as np

from tomo._compile import compiled
from tomo.trace.courses import SLOPE_B, SLOPE_C, START_B, START_C

LANES = 8  # changes that are computed together; those beyond the last are not used


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
def changes(line, first, last, other, other_first, other_last, base, is_b, at, left, parts):
    """Write the changes of column along one axis from ``at`` on, and return their end.

    Parameters
    ----------
    line : (start, slope, layers a voxel, stride)
    first, last : float64
        Voxels along the axis between which the ray is.
    other, other_first, other_last
        The same of the other axis.
    base : float64
    is_b : bool
        Whether this axis is b, and the other c.
    at : int
    left : (at + changes + 7 or more,) int32 or int64
        Written: the place of ``S[k]`` in the column that is left. The one entered is a stride on.
    parts : float64
        Written: ``t - k``.
    """
    start, _, per, stride = line
    other_start, slope, other_per, other_stride = other
    index = left.dtype.type
    origin, count = base + first * stride, int(last - first)
    for m in range((count + LANES - 1) & -LANES):
        number = float(m)
        t = (first + 1.0 + number - start) * per
        layer = np.floor(t)
        nearest = np.floor(other_start + slope * t + 0.5)
        there = (nearest - other_start) * other_per
        after = there > t if is_b else there >= t
        voxel = min(max(nearest - (1.0 if after else 0.0), other_first), other_last)
        to = np.uint64(at + m)  # an index without a sign: no look whether it is negative
        left[to] = index(origin + number * stride + voxel * other_stride + layer)
        parts[to] = t - layer
    return at + count
