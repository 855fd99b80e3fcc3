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

from tomo._numbering import numbering

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
    padded = _padded(mask)
    halved = [part for n in padded.shape for part in (n // _EDGE, *(2,) * BRICK_BITS)]
    order = [
        axis * (BRICK_BITS + 1) + level for level in range(BRICK_BITS + 1) for axis in range(3)
    ]
    by_bricks = padded.reshape(halved).transpose(order)
    place = np.zeros(halved, numbering(mask.size))
    sequence = np.cumsum(by_bricks.ravel(), dtype=place.dtype) - 1
    place.transpose(order)[...] = sequence.reshape(by_bricks.shape)
    return place.reshape(padded.shape)[padded]


def _padded(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return a mask of whole bricks, nothing chosen in what is added."""
    padded = np.zeros([-(-n // _EDGE) * _EDGE for n in mask.shape], np.bool_)
    padded[tuple(slice(0, n) for n in mask.shape)] = mask
    return padded
