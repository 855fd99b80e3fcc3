"""What further threads can gain at most: work that nothing but the machine limits.

Two threads of one core share its arithmetic, and all cores share the way to memory: arithmetic,
or reading, gains no more by a second thread than the machine has left of either. What waits for
its own results gains all.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

PARTS = 64  # many more than threads, so that all end at about the same time
PRODUCTS = 400
ROOTS = 80_000
LARGE = (64, 1_000_000)  # 256 MB: beyond every cache
_MATRIX = 48  # square, and three of them stay in the smallest cache


@compiled(parallel=True)
def _multiply(matrix, corners) -> None:
    """Multiply a matrix by itself, again and again: BLAS keeps a core's arithmetic busy."""
    for part in numba.prange(len(corners)):
        product = np.zeros_like(matrix)
        for _ in range(PRODUCTS):
            np.dot(matrix, matrix, product)
        corners[part] = product[0, 0]


@compiled(parallel=True)
def _take_roots(ends) -> None:
    """Take roots of roots: each begins when the one before has ended."""
    for part in numba.prange(len(ends)):
        value = 0.5
        for _ in range(ROOTS):
            value = np.sqrt(value + 1.0)
        ends[part] = value


@compiled(parallel=True, reassociate=True)
def _sum_rows(values, sums) -> None:
    for part in numba.prange(len(sums)):
        row, total = values[part], np.float32(0)
        for place in range(len(row)):
            total += row[place]
        sums[part] = total


def arithmetic() -> None:
    """Do nothing but multiply and add, on all threads."""
    _multiply(np.eye(_MATRIX), np.zeros(PARTS))


def waiting() -> None:
    """Do nothing but wait for results, on all threads."""
    _take_roots(np.zeros(PARTS))


def reading(values: NDArray[np.float32]) -> None:
    """Do nothing but read ``values``, of the shape `LARGE`, on all threads."""
    _sum_rows(values, np.zeros(len(values), np.float32))
