"""Two neighbours at a time: differences of running sums, and the transpose.

A processor loads and adds two adjacent numbers as fast as one, but a compiler does not find such
pairs behind an index. These loops are written in LLVM's own terms for it; read::

    between_pairs:   sum over m of  (1 - f[m]) (x[i] - x[j]) + f[m] (x[i + 1] - x[j + 1])
    add_pairs:       x[i] += whole - part[m],  x[i + 1] += part[m]
    subtract_pairs:  x[i] -= whole - part[m],  x[i + 1] -= part[m]

with ``i = index[m]`` and ``j = other[m]``. Indices are not checked; whole numbers wrap around.
"""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic

ir = cgutils.ir  # llvmlite's, as numba uses it

CHAINS = 4  # sums that run beside each other: an addition takes as many cycles

_WIDE = ir.IntType(64)
_REAL = ir.DoubleType()


def _arrays(context, builder, signature, args, count):
    """Return the first ``count`` arguments as arrays."""
    return [
        context.make_array(kind)(context, builder, value)
        for kind, value in zip(signature.args[:count], args[:count], strict=True)
    ]


def _index(builder, array, m):
    """Return ``array[m]`` as a 64-bit integer."""
    found = builder.load(builder.gep(array.data, [m]))
    return builder.sext(found, _WIDE) if found.type.width < 64 else found


def _pair_at(builder, pointer, position, element):
    """Return a pointer to the pair of elements that begins at ``position``."""
    pair = ir.VectorType(element, 2).as_pointer()
    return builder.bitcast(builder.gep(pointer, [position]), pair)


def _both(builder, low, high):
    """Return a pair of two numbers."""
    pair = ir.Constant(ir.VectorType(low.type, 2), ir.Undefined)
    for side, value in enumerate((low, high)):
        pair = builder.insert_element(pair, value, ir.Constant(ir.IntType(32), side))
    return pair


def _load(builder, pointer, align):
    loaded = builder.load(pointer)
    loaded.align = align  # a pair stands anywhere
    return loaded


@intrinsic
def between_pairs(typing_context, x, index, other, fraction, count):
    """Sum ``count`` differences, a multiple of four, in double precision; the order is fixed."""

    def generate(context, builder, signature, args):
        x, index, other, fraction = _arrays(context, builder, signature, args, 4)
        element = context.get_data_type(signature.args[0].dtype)
        single = isinstance(element, ir.FloatType)
        pair = ir.VectorType(_REAL, 2)
        zero = ir.Constant(pair, [ir.Constant(_REAL, 0.0)] * 2)
        lower, rises = (
            [cgutils.alloca_once_value(builder, zero) for _ in range(CHAINS)] for _ in range(2)
        )

        def values(places, m):
            at = _index(builder, places, m)
            found = _load(builder, _pair_at(builder, x.data, at, element), 4 if single else 8)
            return builder.fpext(found, pair) if single else found

        def add(total, term):
            builder.store(builder.fadd(builder.load(total), term, flags=["contract"]), total)

        chains = ir.Constant(_WIDE, CHAINS)
        with cgutils.for_range(builder, builder.sdiv(args[4], chains)) as loop:
            first = builder.mul(loop.index, chains)
            for chain in range(CHAINS):
                m = builder.add(first, ir.Constant(_WIDE, chain))
                difference = builder.fsub(values(index, m), values(other, m))
                part = builder.load(builder.gep(fraction.data, [m]))
                add(lower[chain], difference)
                add(
                    rises[chain],
                    builder.fmul(difference, _both(builder, part, part), flags=["contract"]),
                )

        def together(totals):
            a, b, c, d = (builder.load(total) for total in totals)
            return builder.fadd(builder.fadd(a, b), builder.fadd(c, d))

        low, high = (ir.Constant(ir.IntType(32), side) for side in (0, 1))
        lower, rises = together(lower), together(rises)
        rise = builder.fsub(
            builder.extract_element(rises, high), builder.extract_element(rises, low)
        )
        return builder.fadd(builder.extract_element(lower, low), rise)

    return types.float64(x, index, other, fraction, types.int64), generate


@intrinsic
def prefetch(typing_context, x, index, other, count):
    """Tell the processor to fetch what `between_pairs` is going to read."""

    def generate(context, builder, signature, args):
        x, *places = _arrays(context, builder, signature, args, 3)
        byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        to_read, all_levels, data = whole(0), whole(3), whole(1)
        with cgutils.for_range(builder, args[3]) as loop:
            for array in places:
                at = builder.gep(x.data, [_index(builder, array, loop.index)])
                builder.call(fetch, [builder.bitcast(at, byte), to_read, all_levels, data])
        return context.get_dummy_value()

    return types.void(x, index, other, types.int64), generate


@intrinsic
def add_pairs(typing_context, x, index, part, count, whole):
    """Add ``count`` pairs to ``x``."""
    return types.void(x, index, part, types.int64, types.int64), _adding("add")


@intrinsic
def subtract_pairs(typing_context, x, index, part, count, whole):
    """Subtract ``count`` pairs from ``x``."""
    return types.void(x, index, part, types.int64, types.int64), _adding("sub")


def _adding(operation):
    def generate(context, builder, signature, args):
        x, index, part = _arrays(context, builder, signature, args, 3)
        with cgutils.for_range(builder, args[3]) as loop:
            upper = builder.load(builder.gep(part.data, [loop.index]))
            term = _both(builder, builder.sub(args[4], upper), upper)
            target = _pair_at(builder, x.data, _index(builder, index, loop.index), _WIDE)
            total = getattr(builder, operation)(_load(builder, target, 8), term)
            builder.store(total, target).align = 8
        return context.get_dummy_value()

    return generate
