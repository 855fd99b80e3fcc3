"""Arrays of NumPy, CuPy, torch: solvers are written once, for whichever their products come from.

`namespace` returns the functions of an array's library, by the array API standard. With NumPy they
are NumPy's own: what is computed on the CPU keeps its bits. The functions here do what the
standard lacks, or what NumPy does in fewer passes over memory.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_NUMPYS = (np.ndarray, np.generic)


def is_numpy(values: object) -> bool:
    """Return whether these are an array or a number of NumPy's, or Python's own."""
    return isinstance(values, _NUMPYS) or not hasattr(values, "__dlpack__")


def _compat() -> ModuleType:
    try:
        return importlib.import_module("array_api_compat")
    except ImportError as error:
        raise ValueError(
            "array on a device: found no array-api-compat, expected it: "
            "pip install 'flametomo[gpu]'"
        ) from error


def namespace(values: Any) -> Any:
    """Return the functions of the library that an array is of."""
    return np if is_numpy(values) else _compat().array_namespace(values)


def host(values: Any) -> NDArray[Any]:
    """Return an array in NumPy's; a copy where it is on a device."""
    if is_numpy(values):
        return np.asarray(values)
    if values.__dlpack_device__()[0] != np.zeros(0).__dlpack_device__()[0]:
        values = _compat().to_device(values, "cpu")
    return np.asarray(values) if is_numpy(values) else np.from_dlpack(values)


def like(values: NDArray, other: Any) -> Any:
    """Return values of NumPy where another array is, in its library."""
    if is_numpy(other):
        return values
    compat = _compat()
    return compat.array_namespace(other).asarray(values, device=compat.device(other))


def factors(numbers: Any, values: Any) -> Any:
    """Return a number, or one a column, as it multiplies values ``(n,)`` or ``(n, columns)``."""
    if is_numpy(values):
        return numbers
    return like(numbers, values) if np.ndim(numbers) else float(numbers)


def single(number: float) -> float:
    """Return a number rounded to single precision, with which arrays keep theirs."""
    return float(np.float32(number))


def as_type(values: Any, dtype: DTypeLike) -> Any:
    """Return values in another type; themselves where it is theirs."""
    if is_numpy(values):
        return values.astype(dtype, copy=False)
    xp = namespace(values)
    return xp.astype(values, getattr(xp, np.dtype(dtype).name), copy=False)


def zeros(shape: tuple[int, ...], other: Any) -> Any:
    """Return zeros of the type of another array, where it is."""
    if is_numpy(other):
        return np.zeros(shape, other.dtype)
    compat = _compat()
    device = compat.device(other)
    return compat.array_namespace(other).zeros(shape, dtype=other.dtype, device=device)


def chosen(condition: Any, one: Any, other: Any) -> Any:
    """Return ``one`` where a condition holds, ``other`` elsewhere.

    ``condition`` is a truth value, or one of NumPy's a column of ``(n, columns)``.
    """
    if np.ndim(condition) == 0:
        return one if condition else other
    xp = namespace(one)
    return xp.where(like(np.asarray(condition), one), one, other)


def quotient(above: Any, below: Any, otherwise: float = 0.0) -> Any:
    """Return ``above / below``, of one shape, where that is positive; elsewhere ``otherwise``."""
    if is_numpy(below):
        out = np.full(np.shape(below), otherwise, np.result_type(above, below))
        return np.divide(above, below, out=out, where=np.greater(below, 0))
    xp, positive = namespace(below), below > 0
    return xp.where(positive, above / xp.where(positive, below, 1.0), otherwise)


def all_finite(values: Any) -> bool:
    """Return whether no value is NaN or infinite."""
    xp = namespace(values)
    return bool(xp.all(xp.isfinite(values)))


def taken(values: Any, numbers: NDArray[np.integer]) -> Any:
    """Return the values ``(n, ...)`` of some numbers along the first axis."""
    return namespace(values).take(values, like(numbers, values), axis=0)


def flat(values: Any) -> Any:
    """Return values as a vector."""
    return namespace(values).reshape(values, (-1,))
