"""Two neighbours at a time: differences of running sums, and the transpose.

A processor loads and adds two adjacent numbers as fast as one, but a compiler does not find such
pairs behind an index. These loops are written in LLVM's own terms for it (`tomo._compute.simd`);
with ``i = index[m]`` and ``j = i + step``, for all ``m`` before ``end``, read::

    between_pairs:   f[m] = (1 - f[m]) (x[i] - x[j]) + f[m] (x[i + 1] - x[j + 1])
    sum_of:          the sum of f[first:end]
    shares:          p[m] = (whole - s, s), s = f[m] whole rounded to a whole number
    add_pairs:       (x[i], x[i + 1]) += p[m]
    subtract_pairs:  (x[j], x[j + 1]) -= p[m]

Indices are not checked; whole numbers wrap around. ``between_pairs`` and ``shares`` go on to the
next multiple of eight.
"""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic

from tomo._compute.simd import (
    LANES,
    REALS,
    WIDE,
    WIDES,
    array,
    call,
    chosen,
    constant,
    counting,
    halves,
    index,
    ir,
    joined,
    load,
    spread,
    store,
)

_INDEX = types.int64


@intrinsic
def between_pairs(typing_context, x, places, fraction, end, step):
    """Write differences in double precision.

    Differences of single numbers are taken as such: they lose nothing that the numbers' own
    rounding has left.
    """

    def generate(context, builder, signature, args):
        x, places = (array(context, builder, signature, args, which) for which in range(2))
        fraction = array(context, builder, signature, args, 2)
        end, step = args[3:]
        pair = ir.VectorType(context.get_data_type(signature.args[0].dtype), 2)
        entered = builder.gep(x.data, [step])
        with cgutils.for_range_slice(builder, WIDE(0), end, WIDE(LANES)) as (m, _):
            at = [index(builder, places, builder.add(m, WIDE(k))) for k in range(LANES)]
            left, right = (
                joined(builder, [load(builder, builder.gep(column, [i]), pair) for i in at])
                for column in (x.data, entered)
            )
            both = builder.fsub(left, right)
            low, high = (chosen(builder, both, range(side, 2 * LANES, 2)) for side in range(2))
            if isinstance(pair.element, ir.FloatType):
                low, high = builder.fpext(low, REALS), builder.fpext(high, REALS)
            pointer = builder.gep(fraction.data, [m])
            rise = builder.fsub(high, low)
            store(builder, call(builder, "fma", load(builder, pointer, REALS), rise, low), pointer)
        return context.get_dummy_value()

    return types.void(x, places, fraction, _INDEX, _INDEX), generate


@intrinsic
def prefetch_pairs(typing_context, x, places, first, end, step):
    """Tell the processor to fetch the pairs at ``j``.

    That at ``i`` is most often in the line of cache of what the change before or after reads.
    """

    def generate(context, builder, signature, args):
        x, places = (array(context, builder, signature, args, which) for which in range(2))
        first, end, step = args[2:]
        byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        to_read, all_levels, data = whole(0), whole(3), whole(1)
        column = builder.gep(x.data, [step])
        with cgutils.for_range_slice(builder, first, end, WIDE(1)) as (m, _):
            pointer = builder.gep(column, [index(builder, places, m)])
            builder.call(fetch, [builder.bitcast(pointer, byte), to_read, all_levels, data])
        return context.get_dummy_value()

    return types.void(x, places, _INDEX, _INDEX, _INDEX), generate


@intrinsic
def sum_of(typing_context, terms, first, end):
    """Return a sum, taken eight side by side: its order follows from how many there are."""

    def generate(context, builder, signature, args):
        terms = array(context, builder, signature, args, 0)
        first, end = args[1:]
        total = cgutils.alloca_once_value(builder, constant(REALS, 0.0))
        with cgutils.for_range_slice(builder, first, end, WIDE(LANES)) as (m, _):
            some = load(builder, builder.gep(terms.data, [m]), REALS)
            left = spread(builder, builder.sub(end, m))
            counted = builder.icmp_signed("<", counting(WIDES), left)
            some = builder.select(counted, some, constant(REALS, 0.0))
            builder.store(builder.fadd(builder.load(total), some), total)
        total = builder.load(total)
        while total.type.count > 1:
            total = builder.fadd(*halves(builder, total))
        return builder.extract_element(total, ir.IntType(32)(0))

    return types.float64(terms, _INDEX, _INDEX), generate


@intrinsic
def shares(typing_context, fraction, first, end, whole, pairs):
    """Write to ``pairs`` (changes, 2) what a change brings to two neighbours."""

    def generate(context, builder, signature, args):
        fraction = array(context, builder, signature, args, 0)
        pairs = array(context, builder, signature, args, 4)
        first, end, whole = args[1:4]
        scale = spread(builder, builder.sitofp(whole, REALS.element))
        whole = spread(builder, whole)
        with cgutils.for_range_slice(builder, first, end, WIDE(LANES)) as (m, _):
            part = load(builder, builder.gep(fraction.data, [m]), REALS)
            upper = builder.fptosi(call(builder, "rint", builder.fmul(part, scale)), WIDES)
            lanes = [lane for k in range(LANES) for lane in (k, LANES + k)]
            both = chosen(builder, builder.sub(whole, upper), lanes, upper)
            store(builder, both, builder.gep(pairs.data, [builder.shl(m, WIDE(1))]))
        return context.get_dummy_value()

    return types.void(fraction, _INDEX, _INDEX, types.int64, pairs), generate


@intrinsic
def add_pairs(typing_context, x, places, pairs, end):
    """Add pairs at ``i`` to ``x``."""
    return types.void(x, places, pairs, _INDEX), _adding("add")


@intrinsic
def subtract_pairs(typing_context, x, places, pairs, end, step):
    """Subtract pairs at ``j`` from ``x``."""
    return types.void(x, places, pairs, _INDEX, _INDEX), _adding("sub")


def _adding(operation):
    def generate(context, builder, signature, args):
        x, places, pairs = (array(context, builder, signature, args, which) for which in range(3))
        end, *step = args[3:]
        column, pair = builder.gep(x.data, step or [WIDE(0)]), ir.VectorType(WIDE, 2)
        with cgutils.for_range_slice(builder, WIDE(0), end, WIDE(1)) as (m, _):
            term = load(builder, builder.gep(pairs.data, [builder.shl(m, WIDE(1))]), pair)
            target = builder.gep(column, [index(builder, places, m)])
            before = load(builder, target, pair)
            store(builder, getattr(builder, operation)(before, term), target)
        return context.get_dummy_value()

    return generate
