"""Two neighbours at a time: differences of running sums, and the transpose.

A processor loads and adds two adjacent numbers as fast as one, but a compiler does not find such
pairs behind an index. These loops are written in LLVM's own terms for it; read::

    between_pairs:   sum over m of  (1 - f[m]) (x[i] - x[j]) + f[m] (x[i + 1] - x[j + 1])
    add_pairs:       x[i] += whole - part[m],  x[i + 1] += part[m]
    subtract_pairs:  x[i] -= whole - part[m],  x[i + 1] -= part[m]

with ``i = index[m]`` and ``j = i + step``, ``m`` from ``first`` to before ``last``. Indices are
not checked; whole numbers wrap around. Bounds and not slices, for numba counts the references to
an array that it slices.
"""

from __future__ import annotations

from numba.core import cgutils, types
from numba.extending import intrinsic

ir = cgutils.ir  # llvmlite's, as numba uses it

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


def _joined(builder, one, other):
    """Return two pairs as four numbers."""
    order = ir.Constant(ir.VectorType(ir.IntType(32), 4), list(range(4)))
    return builder.shuffle_vector(one, other, order)


def _load(builder, pointer, align):
    loaded = builder.load(pointer)
    loaded.align = align  # a pair stands anywhere
    return loaded


@intrinsic
def between_pairs(typing_context, x, index, step, fraction, first, last):
    """Sum differences in double precision; the order is fixed.

    Four changes are taken together. Differences of single numbers are taken as such: they lose
    nothing that the numbers' own rounding has left.
    """

    def generate(context, builder, signature, args):
        x, index = _arrays(context, builder, signature, args, 2)
        step, first, last = args[2], args[4], args[5]
        fraction = context.make_array(signature.args[3])(context, builder, args[3])
        element = context.get_data_type(signature.args[0].dtype)
        single = isinstance(element, ir.FloatType)
        four = ir.VectorType(_REAL, 4)
        zero = ir.Constant(four, [ir.Constant(_REAL, 0.0)] * 4)
        lower, rises = ([cgutils.alloca_once(builder, four) for _ in range(2)] for _ in range(2))
        for total in (*lower, *rises):
            builder.store(zero, total)

        def pair(at):
            pointer = _pair_at(builder, x.data, at, element)
            return _load(builder, pointer, 4 if single else 8)

        def difference(m):
            at = _index(builder, index, m)
            return builder.fsub(pair(at), pair(builder.add(at, step)))

        def part(m):
            found = builder.load(builder.gep(fraction.data, [m]))
            return _both(builder, found, found)

        def add(total, term):
            builder.store(builder.fadd(builder.load(total), term, flags=["contract"]), total)

        def add_two(chain, differences, parts):
            wide = _joined(builder, *differences)
            wide = builder.fpext(wide, four) if single else wide
            add(lower[chain], wide)
            parts = _joined(builder, *parts)
            add(rises[chain], builder.fmul(wide, parts, flags=["contract"]))

        whole = builder.sub(last, builder.srem(builder.sub(last, first), _WIDE(4)))
        with cgutils.for_range_slice(builder, first, whole, _WIDE(4)) as (start, _):
            for chain in range(2):
                m = [builder.add(start, _WIDE(2 * chain + one)) for one in range(2)]
                add_two(chain, [difference(one) for one in m], [part(one) for one in m])
        nothing = ir.Constant(ir.VectorType(element, 2), [ir.Constant(element, 0.0)] * 2)
        with cgutils.for_range_slice(builder, whole, last, _WIDE(1)) as (m, _):
            add_two(0, [difference(m), nothing], [part(m), part(m)])

        def summed(totals):
            a, b = (builder.load(total) for total in totals)
            return builder.fadd(a, b)

        def lane(vector, number):
            return builder.extract_element(vector, ir.Constant(ir.IntType(32), number))

        lower, rises = summed(lower), summed(rises)
        low = builder.fadd(lane(lower, 0), lane(lower, 2))
        rise = builder.fadd(
            builder.fsub(lane(rises, 1), lane(rises, 0)),
            builder.fsub(lane(rises, 3), lane(rises, 2)),
        )
        return builder.fadd(low, rise)

    wide = types.int64
    return types.float64(x, index, wide, fraction, wide, wide), generate


@intrinsic
def prefetch_pairs(typing_context, x, index, step, first, last):
    """Tell the processor to fetch the pairs at ``j``.

    That at ``i`` is most often in the line of cache of what the change before has entered.
    """

    def generate(context, builder, signature, args):
        x, index = _arrays(context, builder, signature, args, 2)
        byte, whole = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, whole, whole, whole])
        fetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        to_read, all_levels, data = whole(0), whole(3), whole(1)
        step, first, last = args[2:]
        with cgutils.for_range_slice(builder, first, last, _WIDE(1)) as (m, _):
            pointer = builder.gep(x.data, [builder.add(_index(builder, index, m), step)])
            builder.call(fetch, [builder.bitcast(pointer, byte), to_read, all_levels, data])
        return context.get_dummy_value()

    return types.void(x, index, types.int64, types.int64, types.int64), generate


@intrinsic
def add_pairs(typing_context, x, index, part, first, last, whole):
    """Add pairs at ``i`` to ``x``."""
    wide = types.int64
    return types.void(x, index, part, wide, wide, wide), _adding("add")


@intrinsic
def subtract_pairs(typing_context, x, index, step, part, first, last, whole):
    """Subtract pairs at ``j`` from ``x``."""
    wide = types.int64
    return types.void(x, index, wide, part, wide, wide, wide), _adding("sub")


def _adding(operation):
    def generate(context, builder, signature, args):
        x, index = _arrays(context, builder, signature, args, 2)
        *step, part, first, last, total = args[2:]
        part = context.make_array(signature.args[-4])(context, builder, part)
        with cgutils.for_range_slice(builder, first, last, _WIDE(1)) as (m, _):
            upper = builder.load(builder.gep(part.data, [m]))
            term = _both(builder, builder.sub(total, upper), upper)
            at = _index(builder, index, m)
            for more in step:
                at = builder.add(at, more)
            target = _pair_at(builder, x.data, at, _WIDE)
            changed = getattr(builder, operation)(_load(builder, target, 8), term)
            builder.store(changed, target).align = 8
        return context.get_dummy_value()

    return generate
