"""The voxels of a grid brick by brick, so that neighbours are close in memory.

In a flat volume two neighbours along x are a whole layer apart. A ray along x fetches a cache line
for every voxel and uses one number of it; where layers are a power of two apart, the lines even
evict each other. In bricks of 8³ voxels, in Morton order within each (G. M. Morton, "A computer
oriented geodetic data base", IBM 1966), neighbours along every axis are close, and a ray finds in
the cache the voxels that its neighbour fetched.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.index_types import numbering
from tomo._compute.jit import compiled

BRICK_BITS = 3
"""Bits of the position inside a brick along each axis: bricks of 8³ voxels."""

_EDGE = 1 << BRICK_BITS


def brick_storage_index(mask: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return the index of each chosen voxel when they are sorted by bricks.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The voxels that are chosen.

    Returns
    -------
    (n,) int32 or int64
        0 to n - 1, the voxels in the order of the flat volume.
    """
    mask = np.ascontiguousarray(mask)
    index = np.zeros(mask.shape, numbering(mask.size))
    _number(mask, _MORTON, index)
    return index[mask]


def _morton_order() -> NDArray[np.int64]:
    """Return the positions inside a brick in Morton order, ``(8³, 3)``."""
    number, position = np.arange(_EDGE**3), np.zeros((_EDGE**3, 3), np.int64)
    for bit in range(BRICK_BITS):
        for axis in range(3):
            position[:, axis] |= (number >> 3 * bit + 2 - axis & 1) << bit
    return position


_MORTON = _morton_order()


@compiled()
def _number(mask, order, index):
    """Count the chosen voxels brick by brick, and in each in the ``order`` (8³, 3)."""
    nx, ny, nz = mask.shape
    count = 0
    for x in range(0, nx, _EDGE):
        for y in range(0, ny, _EDGE):
            for z in range(0, nz, _EDGE):
                for n in range(len(order)):
                    i, j, k = x + order[n, 0], y + order[n, 1], z + order[n, 2]
                    if i < nx and j < ny and k < nz and mask[i, j, k]:
                        index[i, j, k] = count
                        count += 1
