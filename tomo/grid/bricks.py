"""The voxels of a grid brick by brick, so that neighbours stand together in memory.

In a flat volume two neighbours along x are a whole layer apart. A ray that goes that way fetches a
line of the cache for every voxel and uses one number of it; where layers are a power of two apart,
the lines even drive each other out. In bricks of 8³, and within them halves of halves in turn
(G. M. Morton, "A computer oriented geodetic data base", IBM 1966), neighbours along every axis
stand close, and neighbouring rays find in the cache what the first one fetched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.index_types import numbering
from tomo._compute.jit import compiled

BRICK_BITS = 3
"""Of the place inside a brick, along each axis."""

_EDGE = 1 << BRICK_BITS


def brick_places(mask: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return where each chosen voxel stands among the others when they are sorted by bricks.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The voxels that are chosen.

    Returns
    -------
    (n,) int32 or int64
        The place of each, 0 to n - 1, the voxels in the order of the flat volume.
    """
    mask = np.ascontiguousarray(mask)
    places = np.zeros(mask.shape, numbering(mask.size))
    _place(mask, _HALVES, places)
    return places[mask]


def _halves_of_halves() -> NDArray[np.int64]:
    """Return the places inside a brick in their order, ``(8³, 3)``."""
    number, place = np.arange(_EDGE**3), np.zeros((_EDGE**3, 3), np.int64)
    for bit in range(BRICK_BITS):
        for axis in range(3):
            place[:, axis] |= (number >> 3 * bit + 2 - axis & 1) << bit
    return place


_HALVES = _halves_of_halves()


@compiled()
def _place(mask, halves, places):
    """Count the chosen voxels brick by brick, and in each in the order of ``halves`` (8³, 3)."""
    nx, ny, nz = mask.shape
    count = 0
    for x in range(0, nx, _EDGE):
        for y in range(0, ny, _EDGE):
            for z in range(0, nz, _EDGE):
                for n in range(len(halves)):
                    i, j, k = x + halves[n, 0], y + halves[n, 1], z + halves[n, 2]
                    if i < nx and j < ny and k < nz and mask[i, j, k]:
                        places[i, j, k] = count
                        count += 1
