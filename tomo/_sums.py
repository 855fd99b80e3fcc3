"""Sums in double precision that do not depend on the number of threads, as those of BLAS do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def norm(vector: NDArray) -> float:
    """Return the Euclidean norm."""
    return float(np.sqrt(np.sum(np.square(vector, dtype=np.float64))))


def dot(a: NDArray, b: NDArray) -> float:
    """Return the inner product."""
    return float(np.sum(np.multiply(a, b, dtype=np.float64)))
