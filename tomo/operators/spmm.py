"""Products of a sparse matrix and of its transpose with several vectors at once.

A product with one vector spends its time on reading the matrix. `COLUMNS` vectors that lie side by
side, ``(n, COLUMNS)``, share each entry that is read: a place in the matrix meets one cache line
of them. Rows, parts and private volumes are those of `tomo.operators.spmv`, and each vector's
result has the same bits whatever the others hold and on any number of threads.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.operators.operator import Matrix, as_float
from tomo.operators.spmv import ADDED_AT_ONCE, parts_at_once

COLUMNS = 8
"""Vectors that share a product: their float32 values at one unknown fill a vector register, and a
block of frames has as many. Fewer read the matrix more often, more need a larger cache."""

ENTRY_NANOSECONDS = 1.8
"""Time of an entry and all columns on one thread: less work stays on one thread."""

PIECE = 16
"""Entries that are added up in the vectors' own type before the sum goes on in double precision:
more round more, fewer take longer."""


@compiled(parallel=True)
def _products(starts, stops, voxel, length, volumes, images):
    """Write ``A X`` to ``images`` (P, COLUMNS) of ``volumes`` (n, COLUMNS)."""
    zero = np.zeros(1, volumes.dtype)[0]
    for row in numba.prange(len(images)):
        s, end = np.uint64(starts[row]), np.uint64(stops[row])
        t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
        while s < end:
            stop = min(s + np.uint64(PIECE), end)
            a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = zero
            while s < stop:
                entry, v = length[s], voxel[s]
                a0 += entry * volumes[v, 0]
                a1 += entry * volumes[v, 1]
                a2 += entry * volumes[v, 2]
                a3 += entry * volumes[v, 3]
                a4 += entry * volumes[v, 4]
                a5 += entry * volumes[v, 5]
                a6 += entry * volumes[v, 6]
                a7 += entry * volumes[v, 7]
                s += np.uint64(1)
            t0 += np.float64(a0)
            t1 += np.float64(a1)
            t2 += np.float64(a2)
            t3 += np.float64(a3)
            t4 += np.float64(a4)
            t5 += np.float64(a5)
            t6 += np.float64(a6)
            t7 += np.float64(a7)
        images[row, 0] = t0
        images[row, 1] = t1
        images[row, 2] = t2
        images[row, 3] = t3
        images[row, 4] = t4
        images[row, 5] = t5
        images[row, 6] = t6
        images[row, 7] = t7


@compiled(inline=True)
def _add_row(pixels, voxel, length, start, stop, volumes) -> None:
    """Add ``pixels`` (COLUMNS,) times one row, ``start:stop``, to ``volumes`` (n, COLUMNS)."""
    p0, p1, p2, p3, p4, p5, p6, p7 = (
        pixels[0], pixels[1], pixels[2], pixels[3], pixels[4], pixels[5], pixels[6], pixels[7],
    )  # fmt: skip
    s, end = np.uint64(start), np.uint64(stop)
    while s < end:
        entry, v = length[s], voxel[s]
        x0 = volumes[v, 0] + entry * p0
        x1 = volumes[v, 1] + entry * p1
        x2 = volumes[v, 2] + entry * p2
        x3 = volumes[v, 3] + entry * p3
        x4 = volumes[v, 4] + entry * p4
        x5 = volumes[v, 5] + entry * p5
        x6 = volumes[v, 6] + entry * p6
        x7 = volumes[v, 7] + entry * p7
        volumes[v, 0] = x0
        volumes[v, 1] = x1
        volumes[v, 2] = x2
        volumes[v, 3] = x3
        volumes[v, 4] = x4
        volumes[v, 5] = x5
        volumes[v, 6] = x6
        volumes[v, 7] = x7
        s += np.uint64(1)


@compiled(parallel=True)
def _transposed_products(starts, stops, voxel, length, images, bounds, private, volumes):
    """Add ``A^T Y`` of ``images`` (P, COLUMNS) to ``volumes``, by ``private`` ones."""
    parts, at_once = len(bounds) - 1, len(private)
    for first in range(0, parts, at_once):
        last = min(first + at_once, parts)
        for part in numba.prange(first, last):
            own = private[part - first]
            own[:] = 0
            for row in range(bounds[part], bounds[part + 1]):
                _add_row(images[row], voxel, length, starts[row], stops[row], own)
        for block in numba.prange((len(volumes) + ADDED_AT_ONCE - 1) // ADDED_AT_ONCE):
            start = block * ADDED_AT_ONCE
            stop = min(start + ADDED_AT_ONCE, len(volumes))
            for part in range(last - first):
                for i in range(start, stop):
                    for column in range(COLUMNS):
                        volumes[i, column] += private[part, i, column]


def products(matrix: Matrix, vectors: NDArray[np.floating], entries: int) -> NDArray[np.floating]:
    """Return ``A X`` (pixels, columns) of ``vectors`` (unknowns, columns).

    Parameters
    ----------
    matrix : Matrix
        ``A``; its columns are numbered as the rows of ``vectors``.
    vectors : (unknowns, columns) float32 or float64
    entries : int
        The number of entries of ``A``.
    """
    vectors = as_float(vectors)
    result = np.zeros((len(matrix[0]), vectors.shape[1]), vectors.dtype)
    for first in range(0, vectors.shape[1], COLUMNS):
        group = _columns_from(vectors, first)
        images = np.zeros((len(result), COLUMNS), vectors.dtype)
        with threads_worth(ENTRY_NANOSECONDS * entries):
            _products(*matrix, group, images)
        result[:, first : first + COLUMNS] = images[:, : vectors.shape[1] - first]
    return result


def transposed_products(
    matrix: Matrix,
    images: NDArray[np.floating],
    bounds: NDArray[np.int64],
    n_unknowns: int,
    entries: int,
) -> NDArray[np.floating]:
    """Return ``A^T Y`` (unknowns, columns) of ``images`` (pixels, columns).

    Parameters
    ----------
    matrix : Matrix
    images : (pixels, columns) float32 or float64
    bounds : (parts + 1,) int64
        See `tomo.operators.spmv.part_bounds`.
    n_unknowns, entries : int
    """
    images = as_float(images)
    result = np.zeros((n_unknowns, images.shape[1]), images.dtype)
    at_once = parts_at_once(len(bounds) - 1, COLUMNS * n_unknowns * images.itemsize)
    private = np.zeros((at_once, n_unknowns, COLUMNS), images.dtype)
    rounds = -(-(len(bounds) - 1) // at_once)
    for first in range(0, images.shape[1], COLUMNS):
        volumes = np.zeros((n_unknowns, COLUMNS), images.dtype)
        with threads_worth(ENTRY_NANOSECONDS * entries / rounds):
            _transposed_products(*matrix, _columns_from(images, first), bounds, private, volumes)
        result[:, first : first + COLUMNS] = volumes[:, : images.shape[1] - first]
    return result


def _columns_from(vectors: NDArray[np.floating], first: int) -> NDArray[np.floating]:
    """Return columns from ``first`` on, side by side, with zeros where there are too few."""
    if vectors.shape[1] == COLUMNS:
        return vectors
    group = np.zeros((len(vectors), COLUMNS), vectors.dtype)
    taken = vectors[:, first : first + COLUMNS]
    group[:, : taken.shape[1]] = taken
    return group
