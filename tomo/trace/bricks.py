"""Where live voxels are near, on a coarse lattice, so that rays step over empty space.

A ray's course is cut into chunks of faces (`tomo.trace.slabs`). What a chunk passes lies within a
few voxels of its middle along every axis, for no axis is faster than the long one: so one look at
the brick that the middle is in tells whether any of it can be live.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CHUNK = 8
"""Faces that are taken or skipped together: a multiple of what `dot_pairs` takes at a time."""

REACH = CHUNK // 2 + 2
"""Voxels from the middle of a chunk to the last that it gives a length to, rounding included."""

BRICK_BITS = 2
"""A brick is 2^2 voxels along each edge."""

_CELL = 2  # the mask is widened on cells of this edge, not on voxels


def near_live(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return for each brick whether a live voxel is within reach of a chunk amid it.

    Parameters
    ----------
    mask : (nx, ny, nz) bool
        True where a voxel is live.

    Returns
    -------
    (bricks along x, y, z) uint8
    """
    near = _any_in_blocks(mask, _CELL)
    for axis in range(3):
        near = _widened(near, -(-REACH // _CELL), axis)
    return _any_in_blocks(near, (1 << BRICK_BITS) // _CELL).astype(np.uint8)


def _any_in_blocks(mask: NDArray[np.bool_], edge: int) -> NDArray[np.bool_]:
    """Return whether anything is true in each block of ``edge`` along every axis."""
    for axis in range(3):
        mask = np.logical_or.reduceat(mask, np.arange(0, mask.shape[axis], edge), axis=axis)
    return mask


def _widened(mask: NDArray[np.bool_], by: int, axis: int) -> NDArray[np.bool_]:
    """Return whether anything is true within ``by`` places along an axis."""
    mask = np.moveaxis(mask, axis, 0)
    wide = mask.copy()
    for step in range(1, min(by, len(mask) - 1) + 1):
        wide[step:] |= mask[:-step]
        wide[:-step] |= mask[step:]
    return np.moveaxis(wide, 0, axis)
