"""Numbers side by side, in LLVM's own terms.

A compiler finds such vectors in some loops and not in others; where a loop over the changes of a
ray is all the work there is, it is written in them. They are what the processor has: one register,
two, or four.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numba.core import cgutils

ir = cgutils.ir  # llvmlite's, as numba uses it

LANES = 8
WIDE, REAL = ir.IntType(64), ir.DoubleType()
REALS, WIDES = ir.VectorType(REAL, LANES), ir.VectorType(WIDE, LANES)

_NUMBER = ir.IntType(32)


def array(context: Any, builder: Any, signature: Any, args: Sequence, which: int) -> Any:
    """Return an argument as an array."""
    return context.make_array(signature.args[which])(context, builder, args[which])


def constant(kind: Any, *values: float) -> Any:
    """Return a vector of given numbers, or of one given number in all lanes."""
    values = values if len(values) == kind.count else values * kind.count
    return ir.Constant(kind, [ir.Constant(kind.element, value) for value in values])


def counting(kind: Any) -> Any:
    """Return the vector 0, 1, 2, ..."""
    return constant(kind, *range(kind.count))


def spread(builder: Any, value: Any) -> Any:
    """Return a vector with ``value`` in all lanes."""
    kind = ir.VectorType(value.type, LANES)
    nothing = ir.Constant(kind, ir.Undefined)
    return chosen(builder, builder.insert_element(nothing, value, _NUMBER(0)), [0] * LANES)


def chosen(builder: Any, vector: Any, lanes: Sequence[int], other: Any = None) -> Any:
    """Return the lanes of a vector, and of another that follows it, in the order given."""
    order = ir.Constant(ir.VectorType(_NUMBER, len(lanes)), list(lanes))
    return builder.shuffle_vector(vector, vector if other is None else other, order)


def joined(builder: Any, vectors: Sequence) -> Any:
    """Return vectors, a power of two of them, one after another as one."""
    while len(vectors) > 1:
        lanes = range(2 * vectors[0].type.count)
        halves = zip(vectors[::2], vectors[1::2], strict=True)
        vectors = [chosen(builder, one, lanes, other) for one, other in halves]
    return vectors[0]


def halves(builder: Any, vector: Any) -> tuple[Any, Any]:
    """Return the first half of the lanes, and the second."""
    half = vector.type.count // 2
    return tuple(chosen(builder, vector, range(first, first + half)) for first in (0, half))


def call(builder: Any, name: str, *args: Any) -> Any:
    """Call a function that LLVM has for vectors of double precision."""
    kind = ir.FunctionType(REALS, [REALS] * len(args))
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64")
    return builder.call(function, args)


def load(builder: Any, pointer: Any, kind: Any) -> Any:
    """Load a vector that begins at the number at ``pointer``."""
    loaded = builder.load(builder.bitcast(pointer, kind.as_pointer()))
    loaded.align = _bytes(kind)
    return loaded


def store(builder: Any, vector: Any, pointer: Any) -> None:
    """Store a vector from the number at ``pointer`` on."""
    to = builder.bitcast(pointer, vector.type.as_pointer())
    builder.store(vector, to).align = _bytes(vector.type)


def _bytes(kind: Any) -> int:
    """Return how a vector is aligned that stands anywhere in an array."""
    narrow = isinstance(kind.element, ir.FloatType) or getattr(kind.element, "width", 64) == 32
    return 4 if narrow else 8


def looked_up(builder: Any, numbers: Any, places: Any) -> Any:
    """Return ``numbers[places]``, lane by lane; the places are not negative."""
    found = ir.Constant(ir.VectorType(numbers.data.type.pointee, places.type.count), ir.Undefined)
    for lane in map(_NUMBER, range(places.type.count)):
        place = builder.extract_element(places, lane)
        place = builder.zext(place, WIDE) if place.type.width < 64 else place
        value = builder.load(builder.gep(numbers.data, [place]))
        found = builder.insert_element(found, value, lane)
    return found


def index(builder: Any, numbers: Any, m: Any) -> Any:
    """Return ``numbers[m]`` as a 64-bit integer."""
    found = builder.load(builder.gep(numbers.data, [m]))
    return builder.sext(found, WIDE) if found.type.width < 64 else found
