"""The sum along a row of a stored matrix, several entries at a time.

A compiler does not see that values which stand anywhere in a volume can be multiplied together,
so the loop is written in LLVM's own terms. Read::

    row_sum:  sum over k of  float64(length[start + k] * volume[voxel[start + k]])

for the first ``count - count % 8`` entries from ``start`` on. Places are not checked.
"""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic

from tomo._compute.simd import WIDE, array, ir, load, looked_up

LANES = 4  # doubles in a vector
CHAINS = 2  # vectors summed beside each other: an addition takes longer than a load

_LANE = ir.IntType(32)
_REAL = ir.VectorType(ir.DoubleType(), LANES)


def _product(builder, lengths, values):
    """Return the products in double precision, rounded before as their factors are."""
    if lengths.type == values.type:
        found = builder.fmul(lengths, values)
        return found if found.type == _REAL else builder.fpext(found, _REAL)
    return builder.fmul(
        *(x if x.type == _REAL else builder.fpext(x, _REAL) for x in (lengths, values))
    )


@intrinsic
def row_sum(typing_context, volume, voxel, length, start, count):
    """Sum the whole eights of a row's entries in double precision; the order is fixed."""

    def generate(context, builder, signature, args):
        volume, voxel, length = (array(context, builder, signature, args, k) for k in range(3))

        def several(numbers, at):
            kind = ir.VectorType(numbers.data.type.pointee, LANES)
            return load(builder, builder.gep(numbers.data, [at]), kind)

        zero = ir.Constant(_REAL, [0.0] * LANES)
        totals = [cgutils.alloca_once_value(builder, zero) for _ in range(CHAINS)]
        step = WIDE(LANES * CHAINS)
        with cgutils.for_range(builder, builder.sdiv(args[4], step)) as loop:
            first = builder.add(args[3], builder.mul(loop.index, step))
            for chain, total in enumerate(totals):
                at = builder.add(first, WIDE(chain * LANES))
                values = looked_up(builder, volume, several(voxel, at))
                term = _product(builder, several(length, at), values)
                builder.store(builder.fadd(builder.load(total), term), total)
        together = builder.load(totals[0])
        for total in totals[1:]:
            together = builder.fadd(together, builder.load(total))
        sums = [builder.extract_element(together, _LANE(lane)) for lane in range(LANES)]
        while len(sums) > 1:
            pairs = zip(sums[::2], sums[1::2], strict=True)
            sums = [builder.fadd(one, other) for one, other in pairs]
        return sums[0]

    return types.float64(volume, voxel, length, types.int64, types.int64), generate
