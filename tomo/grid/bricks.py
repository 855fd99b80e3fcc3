"""The order in which voxels are stored: brick by brick, so that neighbours are near in memory.

In a flat volume two neighbours along x are a whole layer apart. A ray along x then loads a cache
line for every voxel and uses one number of it. In bricks of 8³ voxels, and inside them in Morton
order, neighbours along every axis are near, and neighbouring rays find in the cache the voxels
that the first of them loaded.

G. M. Morton, "A computer oriented geodetic data base", IBM 1966.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.index_types import index_type
from tomo._compute.jit import compiled

BRICK_BITS = 3
"""Bits of a voxel's coordinate inside a brick: 8³ float32 are 2 kB, a part of a cache."""

_EDGE = 1 << BRICK_BITS


def brick_order(mask: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return the storage index of each chosen voxel.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        The voxels that are chosen.

    Returns
    -------
    (n,) int32 or int64
        A permutation of 0 to n - 1; entry ``i`` belongs to the i-th chosen voxel in C order.
    """
    mask = np.ascontiguousarray(mask)
    index = np.zeros(mask.shape, index_type(mask.size))
    _count(mask, _MORTON, index)
    return index[mask]


def _morton_order() -> NDArray[np.int64]:
    """Return the coordinates inside a brick in Morton order, ``(8³, 3)``."""
    number, coordinates = np.arange(_EDGE**3), np.zeros((_EDGE**3, 3), np.int64)
    for bit in range(BRICK_BITS):
        for axis in range(3):
            coordinates[:, axis] |= (number >> 3 * bit + 2 - axis & 1) << bit
    return coordinates


_MORTON = _morton_order()


@compiled()
def _count(mask, order, index):
    """Write the chosen voxels' numbers, brick by brick, inside each in ``order`` (8³, 3)."""
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
