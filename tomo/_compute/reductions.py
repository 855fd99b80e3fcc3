"""Sums in double precision and in a fixed order: the same bits on any number of threads.

Unlike BLAS. On a device the upper half of the values is added to the lower one until the CPU adds
what is left, about the square root of their number, from the first to the last. These are
elementwise sums alone: the same bits in every run, by every library and on every device.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, flat, host, is_numpy, namespace
from tomo._compute.jit import compiled


@compiled(reassociate=True)
def _inner_product(a, b):
    """Return the sum of the products of two vectors of one length."""
    total = 0.0
    for i in range(len(a)):
        total += np.float64(a[i]) * np.float64(b[i])
    return total


@compiled()
def _inner_products(a, b, totals):
    """Add to ``totals`` the inner products of the columns of ``a`` and ``b`` (n, columns)."""
    for i in range(len(a)):
        for column in range(len(totals)):
            totals[column] += np.float64(a[i, column]) * np.float64(b[i, column])


def norm(vector: Any) -> float:
    """Return the Euclidean norm."""
    return float(np.sqrt(dot(vector, vector)))


def inner(a: Any, b: Any) -> np.float64 | NDArray[np.float64]:
    """Return the inner product of vectors (n,), or those of the columns of arrays (n, columns)."""
    if a.ndim == 1:
        return np.float64(dot(a, b))
    if not is_numpy(a):
        return _on_device(as_type(a, np.float64) * b)
    totals = np.zeros(a.shape[1])
    _inner_products(np.ascontiguousarray(a), np.ascontiguousarray(b), totals)
    return totals


def dot(a: Any, b: Any) -> float:
    """Return the inner product of arrays of one shape."""
    if a.shape != b.shape:
        raise ValueError(f"inner product: found shapes {a.shape} and {b.shape}, expected one")
    if not is_numpy(a):
        return float(_on_device(flat(as_type(a, np.float64) * b)[:, None])[0])
    dtype = np.float32 if a.dtype == b.dtype == np.float32 else np.float64
    return _inner_product(_vector(a, dtype), _vector(b, dtype))


def total(values: Any) -> np.float64 | NDArray[np.float64]:
    """Return the sum of values (n,), or those of the columns of (n, columns)."""
    if is_numpy(values):
        return values.sum(axis=0, dtype=np.float64)
    double = as_type(values, np.float64)
    found = _on_device(double[:, None] if values.ndim == 1 else double)
    return np.float64(found[0]) if values.ndim == 1 else found


def largest(values: Any) -> Any:
    """Return the largest of values (n,), or of each column of (n, columns); at least 0."""
    if is_numpy(values):
        return values.max(axis=0, initial=0.0)
    if values.shape[0] == 0:
        return np.zeros(tuple(values.shape[1:]), np.float32)[()]
    return np.maximum(host(namespace(values).max(values, axis=0)), 0)[()]


def _on_device(values: Any) -> NDArray[np.float64]:
    """Return the sums of the columns of an array (n, columns) float64 on a device."""
    xp, all_of_them = namespace(values), values.shape[0]
    while (count := values.shape[0]) ** 2 > max(all_of_them, 1):  # more take longer to copy
        half = count // 2
        lower = values[:half, :] + values[half : 2 * half, :]
        values = lower if count % 2 == 0 else xp.concat([lower, values[2 * half :, :]])
    left, totals = np.array(host(values), order="C"), np.zeros(values.shape[1])
    _inner_products(left, np.ones_like(left), totals)
    return totals


def _vector(array: NDArray, dtype: type) -> NDArray[np.floating]:
    """Return a contiguous, writeable vector: the loop is compiled for no other."""
    vector: NDArray = np.ascontiguousarray(array, dtype).reshape(-1)
    return vector if vector.flags.writeable else vector.copy()
