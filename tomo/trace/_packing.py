"""Crossings one behind the other, eight at a time, where the processor can do that.

Which of the pieces of some layers have a length, and lie in a voxel that has a number, is as good
as random: branches are guessed wrongly, and without any each piece waits for the one before it.
AVX-512 moves the lanes of a vector that count to its front, which LLVM has a function for
(`tomo._compute.simd`). Elsewhere that function goes through memory, slower than a loop over the
pieces.
"""

from __future__ import annotations

import numpy as np
from numba.core import cgutils, types
from numba.extending import intrinsic

from tomo._compute.jit import compiled
from tomo._compute.simd import (
    LANES,
    REALS,
    WIDE,
    WIDES,
    array,
    chosen,
    constant,
    counting,
    ir,
    load,
    looked_up,
    spread,
    store,
)

PIECES = 3
"""Of a ray in a layer, at most."""

ROOM = PIECES * LANES
"""Entries behind the last that counts in which anything may be written."""


@intrinsic
def picks_lanes(typing_context):
    """Return whether the processor moves the lanes that count to the front of a vector."""

    def generate(context, builder, signature, args):
        *_, features = context.codegen().magic_tuple()
        return context.get_constant(types.boolean, "+avx512vl" in features.split(","))

    return types.boolean(), generate


def _packing(numbered):
    """Return what packs pieces under their voxels' numbers, or under the voxels' own."""

    @intrinsic
    def pack(typing_context, layers, pieces, number, at, voxel, length):
        def generate(context, builder, signature, args):
            pieces, number, voxel, length = (
                array(context, builder, signature, args, which) for which in (1, 2, 4, 5)
            )
            layers, at = args[0], args[3]
            whole, real = (context.get_data_type(signature.args[k].dtype) for k in (4, 5))
            is_layer = builder.icmp_signed("<", counting(WIDES), spread(builder, layers))
            owns, founds = [], []
            for piece in range(PIECES):
                found, own = (
                    load(builder, builder.gep(pieces.data, [WIDE(part * LANES)]), REALS)
                    for part in (piece, PIECES + piece)
                )
                counts = builder.fcmp_ordered(">", found, constant(REALS, 0.0))
                counts = builder.and_(counts, is_layer)
                own = builder.fptosi(own, WIDES)
                if numbered:
                    own = builder.select(counts, own, constant(WIDES, 0))
                    own = looked_up(builder, number, own)
                own = _as(builder, own, whole)
                owns.append(builder.select(counts, own, constant(own.type, -1)))
                founds.append(_as(builder, found, real))
            in_order = zip(_in_order(builder, owns), _in_order(builder, founds), strict=True)
            for own, found in in_order:
                counts = builder.icmp_signed(">=", own, constant(own.type, 0))
                for some, to in ((own, voxel), (found, length)):
                    store(builder, _picked(builder, some, counts), builder.gep(to.data, [at]))
                bits = builder.bitcast(counts, ir.IntType(LANES))
                at = builder.add(at, builder.zext(builder.ctpop(bits), WIDE))
            return at

        at_type = types.uint64
        return at_type(types.int64, pieces, number, at_type, voxel, length), generate

    return pack


def _as(builder, vector, element):
    """Return a vector's numbers in another type of their kind."""
    kind = ir.VectorType(element, LANES)
    if vector.type == kind:
        return vector
    if isinstance(element, (ir.FloatType, ir.DoubleType)):
        return builder.fptrunc(vector, kind)
    is_wider = element.width > vector.type.element.width
    return builder.sext(vector, kind) if is_wider else builder.trunc(vector, kind)


def _in_order(builder, vectors):
    """Return the lanes of three vectors, the first of each before the second, as three vectors."""
    first, second, third = vectors
    pairs = [lane for k in range(LANES) for lane in (k, LANES + k)]
    both = chosen(builder, first, pairs, second)
    third = chosen(builder, third, [*range(LANES)] * 2)
    order = [lane for k in range(LANES) for lane in (2 * k, 2 * k + 1, 2 * LANES + k)]
    return [
        chosen(builder, both, order[start : start + LANES], third)
        for start in range(0, PIECES * LANES, LANES)
    ]


def _picked(builder, vector, counts):
    """Return a vector with the lanes that count first; the others are anything."""
    kind = vector.type
    names = {"i32": "i32", "i64": "i64", "float": "f32", "double": "f64"}
    name = f"llvm.experimental.vector.compress.v{LANES}{names[str(kind.element)]}"
    signature = ir.FunctionType(kind, [kind, counts.type, kind])
    function = cgutils.get_or_insert_function(builder.module, signature, name)
    return builder.call(function, [vector, counts, ir.Constant(kind, ir.Undefined)])


pack_numbered, pack_own = _packing(True), _packing(False)
"""Write the pieces that have a length, in voxels with a number, from ``at`` on; return their end.

Parameters
----------
layers : int
    How many there are of, up to eight.
pieces : (48 or more,) float64
    For all layers each the lengths of the first, second and third piece, then their voxels.
number : (voxels,) int
    The number of each voxel, negative where it has none; not looked at by ``pack_own``.
at : uint64
voxel, length : (at + ROOM or more,)
    Written.
"""


@compiled(inline=True)
def _numbered(pieces, piece, layer, number):
    """Return the number of a piece's voxel, its own where ``number`` is empty, and its length."""
    voxel = np.int64(pieces[np.uint64((3 + piece) * LANES + layer)])
    found = pieces[np.uint64(piece * LANES + layer)]
    return (number[np.uint64(voxel)] if len(number) > 0 else voxel), found


@compiled(inline=True)
def _pack_one_by_one(layers, is_end, pieces, number, at, voxel, length):
    """Write the pieces that have a length, in voxels with a number, from index ``at`` on.

    Returns where they end. Others are overwritten by what comes next, without a branch; nothing
    need come after the last layer of a run.
    """
    for layer in range(layers - 1 if is_end else layers):
        for piece in range(2):
            own, found = _numbered(pieces, piece, layer, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64((found > 0) & (own >= 0))
        if pieces[np.uint64(2 * LANES + layer)] > 0:  # rare
            own, found = _numbered(pieces, 2, layer, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64(own >= 0)
    if is_end:
        for piece in range(3):
            own, found = _numbered(pieces, piece, layers - 1, number)
            if found > 0 and own >= 0:
                voxel[at] = own
                length[at] = found
                at += np.uint64(1)
    return at


@compiled(inline=True)
def pack(layers, is_end, pieces, number, at, room, voxel, length):
    """Write the pieces that have a length, in voxels with a number, from index ``at`` on.

    Returns where they end. Up to ``room`` anything may be written behind them; nothing need come
    after the last layer of a run, which ``is_end`` tells.
    """
    if not (picks_lanes() and at + np.uint64(ROOM) <= room):
        return _pack_one_by_one(layers, is_end, pieces, number, at, voxel, length)
    if len(number) > 0:
        return pack_numbered(layers, pieces, number, at, voxel, length)
    return pack_own(layers, pieces, number, at, voxel, length)


@compiled(inline=True)
def pack_middles(layers, pieces, number, at, entry, direction, spacing, shape, middle):
    """Write the middles of the pieces that `pack` keeps, from the grid's centre."""
    for layer in range(layers):
        for piece in range(3):
            own, found = _numbered(pieces, piece, layer, number)
            if found > 0 and own >= 0:
                time = pieces[(6 + piece) * LANES + layer]
                for axis in range(3):
                    from_centre = entry[axis] - shape[axis] / 2 + direction[axis] * time
                    middle[at, axis] = from_centre * spacing[axis]
                at += np.uint64(1)
