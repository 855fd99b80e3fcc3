"""Segments one behind the other: those that have a length, in voxels that have a number."""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled

SLABS = 8
"""Slabs cut at a time: as many float64 as a vector register holds; more cut slabs in vain."""


@compiled(inline=True)
def _numbered(cuts, part, slab, number):
    """Return the number of a segment's voxel and its length; the flat index without ``number``."""
    voxel = np.int64(cuts[np.uint64((3 + part) * SLABS + slab)])
    found = cuts[np.uint64(part * SLABS + slab)]
    return (number[np.uint64(voxel)] if len(number) > 0 else voxel), found


@compiled(inline=True)
def pack(slabs, is_end, cuts, number, at, voxel, length):
    """Write the segments that have a length, in voxels with a number, from index ``at`` on.

    Returns their end. Others are written too, without a branch, and overwritten by the next;
    after the last slab of a ray (``is_end``) nothing is written behind the end.
    """
    for slab in range(slabs - 1 if is_end else slabs):
        for part in range(2):
            own, found = _numbered(cuts, part, slab, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64((found > 0) & (own >= 0))
        if cuts[np.uint64(2 * SLABS + slab)] > 0:  # rare
            own, found = _numbered(cuts, 2, slab, number)
            voxel[at] = own
            length[at] = found
            at += np.uint64(own >= 0)
    if is_end:
        for part in range(3):
            own, found = _numbered(cuts, part, slabs - 1, number)
            if found > 0 and own >= 0:
                voxel[at] = own
                length[at] = found
                at += np.uint64(1)
    return at


@compiled(inline=True)
def pack_middles(slabs, cuts, number, at, entry, direction, spacing, shape, middle):
    """Write the midpoints of the segments that `pack` keeps, from the grid's centre."""
    for slab in range(slabs):
        for part in range(3):
            own, found = _numbered(cuts, part, slab, number)
            if found > 0 and own >= 0:
                time = cuts[(6 + part) * SLABS + slab]
                for axis in range(3):
                    from_centre = entry[axis] - shape[axis] / 2 + direction[axis] * time
                    middle[at, axis] = from_centre * spacing[axis]
                at += np.uint64(1)
