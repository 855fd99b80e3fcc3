"""Inner products in double precision that do not depend on the number of threads, unlike BLAS."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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


def norm(vector: NDArray) -> float:
    """Return the Euclidean norm."""
    return float(np.sqrt(dot(vector, vector)))


def inner(a: NDArray, b: NDArray) -> np.float64 | NDArray[np.float64]:
    """Return the inner product of vectors (n,), or those of the columns of arrays (n, columns)."""
    if a.ndim == 1:
        return np.float64(dot(a, b))
    totals = np.zeros(a.shape[1])
    _inner_products(np.ascontiguousarray(a), np.ascontiguousarray(b), totals)
    return totals


def dot(a: NDArray, b: NDArray) -> float:
    """Return the inner product of arrays of one shape."""
    if a.shape != b.shape:
        raise ValueError(f"inner product: found shapes {a.shape} and {b.shape}, expected one")
    dtype = np.float32 if a.dtype == b.dtype == np.float32 else np.float64
    return _inner_product(_flat(a, dtype), _flat(b, dtype))


def _flat(array: NDArray, dtype: type) -> NDArray[np.floating]:
    """Return a contiguous, writeable vector: the loop is compiled for no other."""
    flat: NDArray = np.ascontiguousarray(array, dtype).reshape(-1)
    return flat if flat.flags.writeable else flat.copy()
