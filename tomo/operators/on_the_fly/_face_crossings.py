"""Where a ray changes its column, and at which layer: no work for layers passed inside a column.

A ray passes the planes between columns along b at ``t(i) = (i - start) / slope`` and likewise
along c: two regular families. Where a plane of one is passed, the ray's place along the other is a
count of that one's planes passed before. Both counts compare the same two numbers ``t``, planes of
c first where they are equal: so there is one order of all changes, and the running sums of columns
that are entered and left cancel.
"""

from __future__ import annotations

import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from tomo._compute.jit import compiled
from tomo._compute.simd import (
    LANES,
    REAL,
    REALS,
    WIDE,
    array,
    call,
    constant,
    counting,
    ir,
    spread,
    store,
)
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


def _changes(other_is_before):
    """Return what writes the changes of column along one axis."""

    @intrinsic
    def write(typing_context, own, span, other, other_span, base, places, parts, at):
        def generate(context, builder, signature, args):
            own, span, other, other_span = (
                cgutils.unpack_tuple(builder, value) for value in args[:4]
            )
            places, parts = (array(context, builder, signature, args, k) for k in (5, 6))
            base, at = args[4], args[7]
            first, last = span
            count = builder.fptosi(builder.fsub(last, first), WIDE)
            # the lower of two columns: where the axis is mirrored, that which is entered
            lower = _smaller(builder, own[3], REAL(0.0))
            line = builder.fadd(builder.fadd(base, lower), builder.fmul(first, own[3]))
            stride = spread(builder, own[3])
            line = call(builder, "fma", counting(REALS), stride, spread(builder, line))
            plane = builder.fadd(first, REAL(1.0))
            plane = builder.fadd(counting(REALS), spread(builder, plane))
            plane, line = (cgutils.alloca_once_value(builder, some) for some in (plane, line))
            start, _, per, _ = (spread(builder, value) for value in own)
            to, slope, of, across = (spread(builder, value) for value in other)
            lowest, highest = (spread(builder, value) for value in other_span)
            step = builder.fmul(stride, constant(REALS, LANES))
            kind = ir.VectorType(context.get_data_type(signature.args[5].dtype), LANES)
            with cgutils.for_range_slice(builder, WIDE(0), count, WIDE(LANES)) as (m, _):
                t = builder.fmul(builder.fsub(builder.load(plane), start), per)
                layer = call(builder, "floor", t)
                nearest = call(builder, "rint", call(builder, "fma", t, slope, to))
                there = builder.fmul(builder.fsub(nearest, to), of)
                ahead = builder.fcmp_ordered(">" if other_is_before else ">=", there, t)
                voxel = builder.fsub(nearest, constant(REALS, 1.0))
                voxel = builder.select(ahead, voxel, nearest)
                voxel = _smaller(builder, _larger(builder, voxel, lowest), highest)
                column = builder.fadd(builder.load(line), layer)
                place = builder.fptosi(call(builder, "fma", voxel, across, column), kind)
                here = builder.add(at, m)
                store(builder, place, builder.gep(places.data, [here]))
                store(builder, builder.fsub(t, layer), builder.gep(parts.data, [here]))
                for value, more in ((plane, constant(REALS, LANES)), (line, step)):
                    builder.store(builder.fadd(builder.load(value), more), value)
            end = builder.add(at, count)
            store(builder, constant(kind, 0), builder.gep(places.data, [end]))
            return end

        real, whole = types.float64, types.int64
        line, two = types.UniTuple(real, 4), types.UniTuple(real, 2)
        return whole(line, two, line, two, real, places, parts, whole), generate

    return write


def _larger(builder, one, other):
    return builder.select(builder.fcmp_ordered("<", one, other), other, one)


def _smaller(builder, one, other):
    return builder.select(builder.fcmp_ordered("<", other, one), other, one)


changes_of_b, changes_of_c = _changes(True), _changes(False)
"""Write the changes of column along b, or c, from ``at`` on, and return their end.

Parameters
----------
own, other : (start, slope, layers a voxel, stride)
    The line along the axis, and that along the other one.
span, other_span : (float64, float64)
    Voxels along them between which the ray is.
base : float64
places : (end + 8 or more,) int32 or int64
    Written: the place of ``S[k]`` in the lower of the two columns; that in the upper one is a
    stride on. Zeros from the end on.
parts : (end + 8 or more,) float64
    Written: ``t - k``.
at : int
"""
