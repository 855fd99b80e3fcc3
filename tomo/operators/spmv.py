"""Products with a stored matrix and with its transpose, from one copy of its rows.

Row ``p`` owns the entries ``starts[p]:stops[p]``, so that rows can be left out, repeated or
reordered without a copy. Entries are read once each: in a product with a volume every row is a sum
of its own; in one with images the rows are cut into parts that do not depend on the number of
threads, every part adds into a volume of its own, and the volumes are summed part by part. Both
are the same bits on any number of threads, and nothing is written twice at a time.

Voxel numbers and places are unsigned here: a signed index costs a test for a negative one.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.operators._row_sum import CHAINS, LANES, row_sum

MOST_PARTS = 16
PRIVATE_BYTES = 1 << 22
"""Of parts' volumes at one time, should these not be one a thread: every round of parts wakes and
awaits all threads, and what is beyond the caches is slower."""

NANOSECONDS_GATHERED, NANOSECONDS_SCATTERED = 0.32, 0.5  # an entry, on one thread
ENTRIES_A_PRIVATE_VOXEL = 2  # to clear and add a voxel of a part costs about as much as an entry
ADDED_AT_ONCE = 2048  # voxels: what a thread adds stays in its cache
_AT_ONCE = CHAINS * LANES


@compiled(inline=True)
def projected(volume, voxel, length, start, stop) -> float:
    """Return the sum over entries ``start:stop`` (int64) in double precision, in lanes."""
    total = row_sum(volume, voxel, length, start, stop - start)
    for s in range(np.uint64(stop - (stop - start) % _AT_ONCE), np.uint64(stop)):
        total += np.float64(length[s] * volume[voxel[s]])
    return total


@compiled(inline=True)
def spread(pixel, voxel, length, start, stop, volume) -> None:
    """Add to ``volume`` (n,) what entries ``start:stop`` bring of a pixel."""
    s, end = np.uint64(start), np.uint64(stop)
    while s < end:
        volume[voxel[s]] += length[s] * pixel
        s += np.uint64(1)


@compiled(parallel=True)
def _gather(starts, stops, voxel, length, volume, images):
    """Write to ``images`` (P,) the product of the matrix with ``volume`` (n,).

    Rows are summed in double precision, in lanes.
    """
    for row in numba.prange(len(images)):
        start, stop = np.int64(starts[row]), np.int64(stops[row])
        images[row] = projected(volume, voxel, length, start, stop)


@compiled(parallel=True, reassociate=True)
def _add_up(starts, stops, length, sums):
    """Write to ``sums`` (P,) the product of the matrix with ones: no voxel need be looked at."""
    for row in numba.prange(len(sums)):
        total = 0.0
        for s in range(np.uint64(starts[row]), np.uint64(stops[row])):
            total += np.float64(length[s])
        sums[row] = total


@compiled(parallel=True)
def _scatter(starts, stops, voxel, length, images, bounds, private, volume):
    """Sum each part's rows in ``private`` (at once, n), and add these to ``volume`` (n,)."""
    parts, at_once = len(bounds) - 1, len(private)
    for first in range(0, parts, at_once):
        last = min(first + at_once, parts)
        for part in numba.prange(first, last):
            own = private[part - first]
            for i in range(len(own)):
                own[i] = 0
            for row in range(bounds[part], bounds[part + 1]):
                if images[row] != 0:
                    spread(images[row], voxel, length, starts[row], stops[row], own)
        for block in numba.prange((len(volume) + ADDED_AT_ONCE - 1) // ADDED_AT_ONCE):
            start = block * ADDED_AT_ONCE
            stop = min(start + ADDED_AT_ONCE, len(volume))
            total = volume[start:stop]
            for part in range(last - first):
                own = private[part, start:stop]
                for i in range(len(total)):
                    total[i] += own[i]


def part_bounds(counts: NDArray[np.int64], n_unknowns: int) -> NDArray[np.int64]:
    """Return where to cut rows of ``counts`` entries into parts of equal work: (parts + 1,).

    As many as clearing and adding up the parts' volumes is worth: fewer for few entries.
    """
    worth = int(counts.sum()) // (ENTRIES_A_PRIVATE_VOXEL * max(n_unknowns, 1))
    parts = min(worth, MOST_PARTS)
    if parts <= 1:
        return np.array([0, len(counts)])
    before = np.concatenate([[0], np.cumsum(counts)])
    cuts = np.searchsorted(before, before[-1] * np.arange(1, parts) // parts)
    return np.concatenate([[0], cuts, [len(counts)]]).astype(np.int64)


def parts_at_once(parts: int, nbytes: int) -> int:
    """Return how many parts have volumes, of so many bytes each, of their own at a time.

    As many as there are threads, or as have small volumes together.
    """
    return min(max(numba.get_num_threads(), PRIVATE_BYTES // max(nbytes, 1)), parts)


def gather(
    starts: NDArray[np.int64],
    stops: NDArray[np.int64],
    voxel: NDArray[np.unsignedinteger],
    length: NDArray[np.floating],
    volume: NDArray[np.floating],
    images: NDArray[np.floating],
    entries: int,
) -> None:
    """Write to ``images`` (P,) the product of the matrix, of so many entries, with ``volume``."""
    with threads_worth(NANOSECONDS_GATHERED * entries):
        _gather(starts, stops, voxel, length, volume, images)


def sums_of_rows(
    starts: NDArray[np.int64],
    stops: NDArray[np.int64],
    length: NDArray[np.floating],
    entries: int,
) -> NDArray[np.float64]:
    """Return the sum of every row's entries, of so many in all: (P,)."""
    sums = np.zeros(len(starts))
    with threads_worth(NANOSECONDS_GATHERED * entries):
        _add_up(starts, stops, length, sums)
    return sums


def scatter(
    starts: NDArray[np.int64],
    stops: NDArray[np.int64],
    voxel: NDArray[np.unsignedinteger],
    length: NDArray[np.floating],
    images: NDArray[np.floating],
    bounds: NDArray[np.int64],
    volume: NDArray[np.floating],
    entries: int,
) -> None:
    """Add to ``volume`` (n,) the product of the transposed matrix with ``images`` (P,)."""
    parts = len(bounds) - 1
    at_once = parts_at_once(parts, volume.nbytes)
    private = np.zeros((at_once, len(volume)), volume.dtype)
    rounds = -(-parts // at_once)
    with threads_worth(NANOSECONDS_SCATTERED * entries / rounds):
        _scatter(starts, stops, voxel, length, images, bounds, private, volume)
