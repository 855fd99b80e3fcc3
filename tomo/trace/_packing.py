"""Segments one behind the other: those that have a length, in voxels that have a number."""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled

SLABS = 8
"""Slabs that a ray is cut in at a time: one loop over them vectorises."""


@compiled(inline=True)
def _numbered(pieces, piece, layer, number):
    """Return the number of a piece's voxel, its own where ``number`` is empty, and its length."""
    voxel = np.int64(pieces[np.uint64((3 + piece) * SLABS + layer)])
    found = pieces[np.uint64(piece * SLABS + layer)]
    return (number[np.uint64(voxel)] if len(number) > 0 else voxel), found


@compiled(inline=True)
def pack(layers, is_end, pieces, number, at, voxel, length):
    """Write the pieces that have a length, in voxels with a number, from index ``at`` on.

    Returns where they end. Others are overwritten by what comes next, without a branch; nothing
    need come after the last layer of a run.
    """
    for layer in range(layers - 1 if is_end else layers):
        for piece in range(2):
            own, found = _numbered(pieces, piece, layer, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64((found > 0) & (own >= 0))
        if pieces[np.uint64(2 * SLABS + layer)] > 0:  # rare
            own, found = _numbered(pieces, 2, layer, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64(own >= 0)
    if is_end:
        for piece in range(3):
            own, found = _numbered(pieces, piece, layers - 1, number)
            if found > 0 and own >= 0:
                voxel[at] = own
                length[at] = found
                at += np.uint64(1)
    return at


@compiled(inline=True)
def pack_middles(layers, pieces, number, at, entry, direction, spacing, shape, middle):
    """Write the middles of the pieces that `pack` keeps, from the grid's centre."""
    for layer in range(layers):
        for piece in range(3):
            own, found = _numbered(pieces, piece, layer, number)
            if found > 0 and own >= 0:
                time = pieces[(6 + piece) * SLABS + layer]
                for axis in range(3):
                    from_centre = entry[axis] - shape[axis] / 2 + direction[axis] * time
                    middle[at, axis] = from_centre * spacing[axis]
                at += np.uint64(1)
