"""Sums in double precision that do not depend on the number of threads, as those of BLAS do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def norm(vector: NDArray) -> float:
    """Return the Euclidean norm."""
    return float(np.sqrt(dot(vector, vector)))


def dot(a: NDArray, b: NDArray) -> float:
    """Return the inner product of arrays of one shape."""
    from tomo._compute.inner_product import inner_product  # compiled code

    if a.shape != b.shape:
        raise ValueError(f"inner product: found shapes {a.shape} and {b.shape}, expected one")
    kind = np.float32 if a.dtype == b.dtype == np.float32 else np.float64
    return inner_product(_flat(a, kind), _flat(b, kind))


def _flat(array: NDArray, kind: type) -> NDArray[np.floating]:
    """Return a vector that the loop is compiled for: in order, and not marked as read-only."""
    flat = np.ascontiguousarray(array, kind).reshape(-1)
    return flat if flat.flags.writeable else flat.copy()
