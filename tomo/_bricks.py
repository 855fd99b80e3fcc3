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

_HALVINGS = 3
_EDGE = 1 << _HALVINGS


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
    inside = tuple(slice(0, n) for n in mask.shape)
    bricks = [-(-n // _EDGE) for n in mask.shape]
    chosen = np.zeros([_EDGE * n for n in bricks], np.bool_)
    chosen[inside] = mask
    halved = [part for n in bricks for part in (n, *(2,) * _HALVINGS)]
    order = [axis * (_HALVINGS + 1) + level for level in range(_HALVINGS + 1) for axis in range(3)]
    by_bricks = chosen.reshape(halved).transpose(order)
    few = mask.size <= np.iinfo(np.int32).max
    place = np.zeros(halved, np.int32 if few else np.int64)
    sequence = np.cumsum(by_bricks.ravel(), dtype=place.dtype) - 1
    place.transpose(order)[...] = sequence.reshape(by_bricks.shape)
    return place.reshape(chosen.shape)[inside][mask]
