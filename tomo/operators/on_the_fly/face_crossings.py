"""Where a ray passes a face between two columns of voxels, and at which position ``t``.

Along b a ray passes face ``i`` at ``t(i) = (i - start) / slope``, and likewise along c. At a face
of one axis, the voxel along the other axis is a count of that axis's faces passed before. Both
counts compare the same two numbers ``t``, with faces of c first where they are equal: there is one
order of all crossings, and the running sums of columns entered and left cancel exactly.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.operators.on_the_fly.ray_setup import SLOPE_B, SLOPE_C, START_B, START_C


@compiled(inline=True)
def lines_of(parameters, ray, shape) -> tuple:
    """Return a ray's lines along b and c, and the index of ``S[0]`` of its column (0, 0).

    A line is ``(start, slope, steps a voxel, stride)``: ``S[k]`` of column ``(b, c)``, both
    counted as the ray's parameters count them, is at that index plus ``b`` and ``c`` times the
    strides, plus ``k``.
    """
    stride_c = float(shape[0] + 1)
    stride_b = stride_c * shape[2]
    slope_b, slope_c, base = parameters[ray, SLOPE_B], parameters[ray, SLOPE_C], 0.0
    if slope_b < 0:
        base += (shape[1] - 1) * stride_b
        slope_b, stride_b = -slope_b, -stride_b
    if slope_c < 0:
        base += (shape[2] - 1) * stride_c
        slope_c, stride_c = -slope_c, -stride_c
    per_b = 1.0 / slope_b if slope_b > 0 else 0.0
    per_c = 1.0 / slope_c if slope_c > 0 else 0.0
    return (
        (parameters[ray, START_B], slope_b, per_b, stride_b),
        (parameters[ray, START_C], slope_c, per_c, stride_c),
        base,
    )


@compiled(inline=True)
def voxel_at(line, t, before) -> float:
    """Return the voxel along b or c at ``t``, or just ``before`` it: the faces passed until then.

    Rounding can be wrong about the nearest face only.
    """
    start, slope, per, _ = line
    if slope == 0:
        return np.floor(start)
    nearest = np.floor(start + slope * t + 0.5)
    at = (nearest - start) * per
    return nearest - (at >= t if before else at > t)


@compiled(inline=True)
def voxel_span(line, enter, leave, count) -> tuple:
    """Return the first and the last of ``count`` voxels that a ray is in along b or c."""
    first = min(max(voxel_at(line, enter, False), 0.0), count - 1.0)
    return first, min(max(voxel_at(line, leave, True), first), count - 1.0)


@compiled(inline=True)
def _crossings(other_is_before, own, span, other, other_span, base, indices, fractions, at):
    """Write a ray's face crossings along one axis; see `crossings_along_b`."""
    start, _, per, stride = own
    other_start, other_slope, other_per, other_stride = other
    lowest, highest = other_span
    first, last = span
    count = np.int64(last - first)
    # the lower column of the two: on a mirrored axis the one that is entered
    column = base + first * stride + (stride if stride < 0 else 0.0)
    for m in range(count):
        t = (first + 1.0 + m - start) * per
        slab = np.floor(t)
        nearest = np.rint(t * other_slope + other_start)
        there = (nearest - other_start) * other_per
        ahead = there > t if other_is_before else there >= t
        voxel = nearest - 1.0 if ahead else nearest
        voxel = lowest if voxel < lowest else voxel
        voxel = highest if highest < voxel else voxel
        here = np.uint64(at + m)
        indices[here] = np.int64(voxel * other_stride + (column + m * stride + slab))
        fractions[here] = t - slab
    return at + count


@compiled(inline=True)
def crossings_along_b(own, span, other, other_span, base, indices, fractions, at) -> int:
    """Write a ray's crossings of faces between voxels along b from ``at`` on; return their end.

    ``own`` and ``other`` are lines as of `lines_of`, the spans the ray's first and last voxel
    along them; ``base`` is the index of ``S[0]`` of column (0, 0). Written: ``indices`` of
    ``S[k]`` in the lower of the two columns, in the upper it is one stride larger, and
    ``fractions`` ``t - k``.
    """
    return _crossings(True, own, span, other, other_span, base, indices, fractions, at)


@compiled(inline=True)
def crossings_along_c(own, span, other, other_span, base, indices, fractions, at) -> int:
    """Write a ray's crossings of faces between voxels along c; see `crossings_along_b`."""
    return _crossings(False, own, span, other, other_span, base, indices, fractions, at)
