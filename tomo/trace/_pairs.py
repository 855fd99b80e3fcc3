"""Two neighbours at a time: sums over, and additions to, pairs of adjacent elements of an array.

A processor loads, multiplies and adds two adjacent numbers as fast as one, but a compiler does not
find such pairs behind an index. These two loops are written in LLVM's own terms for it; read::

    dot_pairs:  sum over k of  weight[2 k] x[index[k]] + weight[2 k + 1] x[index[k] + 1]
    add_pairs:  x[index[k]] += factor weight[2 k],  x[index[k] + 1] += factor weight[2 k + 1]

Indices are not checked.
"""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic

ir = cgutils.ir  # llvmlite's, as numba uses it

CHAINS = 4  # sums that run beside each other: an addition takes as many cycles


def _pair_at(builder, array, position, pair):
    """Return a pointer to the pair of elements of ``array`` that begins at ``position``."""
    return builder.bitcast(builder.gep(array.data, [position]), pair.as_pointer())


def _load(builder, pointer, element):
    """Load a pair that stands anywhere in an array of ``element``."""
    loaded = builder.load(pointer)
    loaded.align = _size(element)
    return loaded


def _size(element):
    """Return the bytes of a real number."""
    return 4 if isinstance(element, ir.FloatType) else 8


def _index(builder, array, k):
    """Return ``array[k]`` as a 64-bit integer."""
    found = builder.load(builder.gep(array.data, [k]))
    wide = ir.IntType(64)
    return builder.sext(found, wide) if found.type.width < 64 else found


def _arrays(context, builder, signature, args, count):
    """Return the first ``count`` arguments as arrays."""
    return [
        context.make_array(kind)(context, builder, value)
        for kind, value in zip(signature.args[:count], args[:count], strict=True)
    ]


@intrinsic
def dot_pairs(typing_context, x, index, weight, count):
    """Sum ``count`` weighted pairs of ``x``, a multiple of four; the order is fixed."""

    def generate(context, builder, signature, args):
        x, index, weight = _arrays(context, builder, signature, args, 3)
        element = context.get_data_type(signature.args[0].dtype)
        pair = ir.VectorType(element, 2)
        two = ir.Constant(ir.IntType(64), 2)
        zero = ir.Constant(pair, [ir.Constant(element, 0.0)] * 2)
        sums = [cgutils.alloca_once_value(builder, zero) for _ in range(CHAINS)]
        blocks = builder.sdiv(args[3], ir.Constant(ir.IntType(64), CHAINS))
        with cgutils.for_range(builder, blocks) as loop:
            first = builder.mul(loop.index, ir.Constant(ir.IntType(64), CHAINS))
            for chain, total in enumerate(sums):
                k = builder.add(first, ir.Constant(ir.IntType(64), chain))
                at = _index(builder, index, k)
                values = _load(builder, _pair_at(builder, x, at, pair), element)
                place = builder.mul(k, two)
                weights = _load(builder, _pair_at(builder, weight, place, pair), element)
                product = builder.fmul(values, weights, flags=["contract"])
                builder.store(
                    builder.fadd(builder.load(total), product, flags=["contract"]), total
                )
        a, b, c, d = (builder.load(total) for total in sums)
        together = builder.fadd(builder.fadd(a, b), builder.fadd(c, d))
        low, high = (
            builder.extract_element(together, ir.Constant(ir.IntType(32), side)) for side in (0, 1)
        )
        return builder.fadd(low, high)

    return x.dtype(x, index, weight, types.int64), generate


@intrinsic
def add_pairs(typing_context, x, index, weight, first, count, factor):
    """Add ``count`` pairs times ``factor`` to ``x``: those of even ``first + k``, then the others.

    Neighbours in ``index`` often overlap by one element: a processor that must put together what
    it has just written in two parts waits for it.
    """

    def generate(context, builder, signature, args):
        x, index, weight = _arrays(context, builder, signature, args, 3)
        element = context.get_data_type(signature.args[0].dtype)
        pair = ir.VectorType(element, 2)
        wide = ir.IntType(64)
        one, two = (ir.Constant(wide, n) for n in (1, 2))
        factors = ir.Constant(pair, ir.Undefined)
        for side in (0, 1):
            place = ir.Constant(ir.IntType(32), side)
            factors = builder.insert_element(factors, args[5], place)
        odd = builder.and_(args[3], one)
        for start in (odd, builder.xor(odd, one)):
            steps = builder.sdiv(builder.add(builder.sub(args[4], start), one), two)
            with cgutils.for_range(builder, steps) as loop:
                k = builder.add(builder.mul(loop.index, two), start)
                target = _pair_at(builder, x, _index(builder, index, k), pair)
                place = builder.mul(k, two)
                weights = _load(builder, _pair_at(builder, weight, place, pair), element)
                product = builder.fmul(weights, factors, flags=["contract"])
                total = builder.fadd(_load(builder, target, element), product, flags=["contract"])
                stored = builder.store(total, target)
                stored.align = _size(element)
        return context.get_dummy_value()

    return types.void(x, index, weight, types.int64, types.int64, x.dtype), generate


@intrinsic
def shifted_right(typing_context, value, places):
    """Return ``value >> places`` in the integer's own width: floor of a division by 2^places.

    numba would widen it to 64 bits, and halve what fits into a vector.
    """

    def generate(context, builder, signature, args):
        return builder.ashr(*args)

    return value(value, value), generate
