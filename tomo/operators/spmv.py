"""Products of a sparse matrix and of its transpose with vectors, from one copy of its rows.

Row ``p`` owns the entries ``starts[p]:stops[p]`` of ``voxel`` and ``length``, so that rows can be
left out, repeated or reordered without a copy. Each product reads every entry once, for one vector
or for `COLUMNS` that lie side by side, ``(n, COLUMNS)``. ``A x`` sums every row by itself.
``A^T y`` cuts the rows into parts that do not depend on the number of threads; each part adds into
a private volume, and the volumes are summed part by part. Both give the same bits on any number of
threads, whatever the other vectors hold, and no two threads write to one number.

Voxel numbers are unsigned here: a signed index costs a test for negative ones.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.operators.operator import Matrix, as_float

MOST_PARTS = 16
"""Parts of the transposed product: fewer leave threads idle, more clear and add more volumes."""

PRIVATE_BYTES = 1 << 22
"""Bytes of the private volumes at one time, if more than one a thread fit: less wakes all threads
more often, more leaves the caches."""

FORWARD_NANOSECONDS, TRANSPOSED_NANOSECONDS = 0.32, 0.5
"""Time of an entry on one thread: work too short for a second thread stays on one."""

ENTRIES_A_PRIVATE_VOXEL = 2
"""Entries whose products take as long as to clear and add one voxel of a private volume."""

ADDED_AT_ONCE = 2048
"""Voxels that a thread adds up at a time: they stay in its cache."""

SUMS_AT_ONCE = 8
"""Partial sums of a row, one entry each in turn: with one, each addition waits for the last."""


@compiled(inline=True)
def _term(volume, voxel, length, start, offset):
    """Return one entry's product, rounded as its factors are, in double precision."""
    s = start + np.uint64(offset)
    return np.float64(length[s] * volume[voxel[s]])


@compiled(inline=True)
def row_product(volume, voxel, length, start, stop) -> float:
    """Return the entries ``start:stop`` (int64) times ``volume``, in double precision."""
    s = np.uint64(start)
    whole, end = np.uint64(stop - (stop - start) % SUMS_AT_ONCE), np.uint64(stop)
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    while s < whole:
        s0 += _term(volume, voxel, length, s, 0)
        s1 += _term(volume, voxel, length, s, 1)
        s2 += _term(volume, voxel, length, s, 2)
        s3 += _term(volume, voxel, length, s, 3)
        s4 += _term(volume, voxel, length, s, 4)
        s5 += _term(volume, voxel, length, s, 5)
        s6 += _term(volume, voxel, length, s, 6)
        s7 += _term(volume, voxel, length, s, 7)
        s += np.uint64(SUMS_AT_ONCE)
    total = ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7))
    while s < end:
        total += _term(volume, voxel, length, s, 0)
        s += np.uint64(1)
    return total


@compiled(inline=True)
def add_row(pixel, voxel, length, start, stop, volume) -> None:
    """Add ``pixel`` times one row, entries ``start:stop``, to ``volume`` (n,)."""
    s, end = np.uint64(start), np.uint64(stop)
    while s < end:
        volume[voxel[s]] += length[s] * pixel
        s += np.uint64(1)


@compiled(parallel=True)
def _product(starts, stops, voxel, length, volume, images):
    """Write ``A x`` to ``images`` (P,) of ``volume`` (n,)."""
    for row in numba.prange(len(images)):
        start, stop = np.int64(starts[row]), np.int64(stops[row])
        images[row] = row_product(volume, voxel, length, start, stop)


@compiled(parallel=True, reassociate=True)
def _add_up(starts, stops, length, sums):
    """Write ``A 1`` to ``sums`` (P,); no voxel is read."""
    for row in numba.prange(len(sums)):
        total = 0.0
        for s in range(np.uint64(starts[row]), np.uint64(stops[row])):
            total += np.float64(length[s])
        sums[row] = total


@compiled(parallel=True)
def _transposed_product(starts, stops, voxel, length, images, bounds, private, volume):
    """Add ``A^T y`` of ``images`` (P,) to ``volume`` (n,), by ``private`` volumes (at once, n)."""
    parts, at_once = len(bounds) - 1, len(private)
    for first in range(0, parts, at_once):
        last = min(first + at_once, parts)
        for part in numba.prange(first, last):
            own = private[part - first]
            for i in range(len(own)):
                own[i] = 0
            for row in range(bounds[part], bounds[part + 1]):
                if images[row] != 0:
                    add_row(images[row], voxel, length, starts[row], stops[row], own)
        for block in numba.prange((len(volume) + ADDED_AT_ONCE - 1) // ADDED_AT_ONCE):
            start = block * ADDED_AT_ONCE
            stop = min(start + ADDED_AT_ONCE, len(volume))
            total = volume[start:stop]
            for part in range(last - first):
                own = private[part, start:stop]
                for i in range(len(total)):
                    total[i] += own[i]


def part_bounds(counts: NDArray[np.int64], n_unknowns: int) -> NDArray[np.int64]:
    """Return the bounds of parts of equal work among rows of ``counts`` entries: (parts + 1,).

    Few entries make few parts: each private volume has to be cleared and added.
    """
    worth = int(counts.sum()) // (ENTRIES_A_PRIVATE_VOXEL * max(n_unknowns, 1))
    parts = min(worth, MOST_PARTS)
    if parts <= 1:
        return np.array([0, len(counts)])
    before = np.concatenate([[0], np.cumsum(counts)])
    cuts = np.searchsorted(before, before[-1] * np.arange(1, parts) // parts)
    return np.concatenate([[0], cuts, [len(counts)]]).astype(np.int64)


def parts_at_once(parts: int, nbytes: int) -> int:
    """Return the number of private volumes, of ``nbytes`` each, at a time.

    One a thread, or as many as `PRIVATE_BYTES` hold.
    """
    return min(max(numba.get_num_threads(), PRIVATE_BYTES // max(nbytes, 1)), parts)


def product(matrix: Matrix, volume: NDArray[np.floating], entries: int) -> NDArray[np.floating]:
    """Return ``A x`` (P,) of ``volume`` (n,), in its type; ``entries`` counts those of ``A``."""
    images = np.zeros(len(matrix[0]), volume.dtype)
    with threads_worth(FORWARD_NANOSECONDS * entries):
        _product(*matrix, volume, images)
    return images


def row_sums(matrix: Matrix, entries: int) -> NDArray[np.float64]:
    """Return ``A 1``: (P,)."""
    starts, stops, _, length = matrix
    sums = np.zeros(len(starts))
    with threads_worth(FORWARD_NANOSECONDS * entries):
        _add_up(starts, stops, length, sums)
    return sums


def transposed_product(
    matrix: Matrix,
    images: NDArray[np.floating],
    bounds: NDArray[np.int64],
    n_unknowns: int,
    entries: int,
) -> NDArray[np.floating]:
    """Return ``A^T y`` (n,) of ``images`` (P,), in its type; parts as of `part_bounds`."""
    volume = np.zeros(n_unknowns, images.dtype)
    parts = len(bounds) - 1
    at_once = parts_at_once(parts, volume.nbytes)
    private = np.zeros((at_once, n_unknowns), volume.dtype)
    rounds = -(-parts // at_once)
    with threads_worth(TRANSPOSED_NANOSECONDS * entries / rounds):
        _transposed_product(*matrix, images, bounds, private, volume)
    return volume


COLUMNS = 8
"""Vectors that share a product: their float32 values at one unknown fill a vector register, and a
block of frames has as many. Fewer read the matrix more often, more need a larger cache."""

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
    """Return ``A X`` (pixels, columns) of ``vectors`` (unknowns, columns), see `product`."""
    vectors = as_float(vectors)
    result = np.zeros((len(matrix[0]), vectors.shape[1]), vectors.dtype)
    for first in range(0, vectors.shape[1], COLUMNS):
        group = _columns_from(vectors, first)
        images = np.zeros((len(result), COLUMNS), vectors.dtype)
        with threads_worth(COLUMNS * FORWARD_NANOSECONDS * entries):
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
    """Return ``A^T Y`` (unknowns, columns) of ``images`` (pixels, columns)."""
    images = as_float(images)
    result = np.zeros((n_unknowns, images.shape[1]), images.dtype)
    at_once = parts_at_once(len(bounds) - 1, COLUMNS * n_unknowns * images.itemsize)
    private = np.zeros((at_once, n_unknowns, COLUMNS), images.dtype)
    rounds = -(-(len(bounds) - 1) // at_once)
    for first in range(0, images.shape[1], COLUMNS):
        volumes = np.zeros((n_unknowns, COLUMNS), images.dtype)
        with threads_worth(COLUMNS * FORWARD_NANOSECONDS * entries / rounds):
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
