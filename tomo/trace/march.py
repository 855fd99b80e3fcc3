"""The compiled exact walk: every slab of voxels by itself, several at a time.

Slabs are one voxel thick, across the driving axis: the one along which the ray advances most, in
voxels. In a slab the ray passes at most one face of each other axis, so it has at most three
segments; where they begin and end follows from the slab's number alone
(`tomo.trace.plane_crossings`). Slabs are therefore independent: the loop over them has no branch
and vectorises, and slabs in empty space are skipped without any effect on the others: as many as
the voxel's distance from the nearest active one allows, at both ends of the ray before any is cut.
`pack` writes segments one behind the other: those that have a length, in voxels with a number.

Jacobs et al., "A fast algorithm to calculate the exact radiological path through a pixel or voxel
space" (Journal of Computing and Information Technology 6, 1998) count crossings in the same way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._compute.grouping import index_type
from tomo._compute.jit import compiled
from tomo._compute.threads import run_ranges, threads_worth
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.rays import Rays
from tomo.trace.plane_crossings import (
    RAYS_TOGETHER,
    WIDTH,
    clear_ahead,
    entry_of,
    greater,
    lesser,
    most_of,
    parameters_of,
    passed,
    passing,
    set_parameters,
    set_slabs,
)
from tomo.trace.segments import Segments

SLABS = 8
"""Slabs cut at a time: as many float64 as a vector register holds; more cut slabs in vain."""


@compiled(inline=True)
def _numbered(cuts, part, slab, number):
    """Return the number of a segment's voxel and its length; the flat index without ``number``."""
    voxel = np.int64(cuts[np.uint64((3 + part) * SLABS + slab)])
    found = cuts[np.uint64(part * SLABS + slab)]
    return (number[np.uint64(voxel)] if len(number) > 0 else voxel), found


@compiled(inline=True)
def pack(slabs, is_end, cuts, number, at, voxel, length) -> None:
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
def pack_middles(slabs, cuts, number, at, entry, direction, spacing, shape, middle) -> None:
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


RAYS_A_CHUNK = 256
"""Rays of a chunk, one thread's at a time: segments of a chunk are contiguous when found."""

_COUNTING, _FILLING = 15.0, 150.0
"""Nanoseconds a ray, at least, of the two passes: see `threads_worth`."""


@compiled(inline=True)
def _cut(start, origin, a, b, c, end, weight, cuts):
    """Cut a ray in `SLABS` slabs from ``start`` on into three segments each, some of no length.

    ``cuts`` (9 * SLABS,) takes, for all slabs each, the lengths times ``weight`` of the first,
    second and third segment, then their voxels, then their midpoints along the ray. One buffer:
    the compiler sees that nothing overlaps.
    """
    for i in range(SLABS):
        slab = float(start + i)
        into = lesser(greater(passing(slab - 1, a), 0.0), end)
        out = lesser(passing(slab, a), end) if slab < a[3] else end
        # Rounding may see two planes passed where there is one: the second comes a slab later.
        b0 = passed(into, b)
        b1 = lesser(greater(passed(out, b), b0), b0 + 1)
        c0 = passed(into, c)
        c1 = lesser(greater(passed(out, c), c0), c0 + 1)
        at_b = lesser(greater(passing(b0, b), into), out) if b1 > b0 else out
        at_c = lesser(greater(passing(c0, c), into), out) if c1 > c0 else out
        sooner, later = lesser(at_b, at_c), greater(at_b, at_c)
        first = origin + slab * a[4] + b0 * b[4] + c0 * c[4]
        step_b, step_c = (b1 - b0) * b[4], (c1 - c0) * c[4]
        cuts[i] = (sooner - into) * weight
        cuts[SLABS + i] = (later - sooner) * weight
        cuts[2 * SLABS + i] = (out - later) * weight
        cuts[3 * SLABS + i] = first
        cuts[4 * SLABS + i] = first + (step_b if at_b < at_c else step_c)
        cuts[5 * SLABS + i] = first + step_b + step_c
        cuts[6 * SLABS + i] = (into + sooner) / 2
        cuts[7 * SLABS + i] = (sooner + later) / 2
        cuts[8 * SLABS + i] = (later + out) / 2


@compiled()
def _fill(
    origins, directions, lengths, weights, box, distance, number, begin, first_chunk, last_chunk,
    counts, voxel, length, middle,
):  # fmt: skip
    """Write the segments of some chunks of rays, each from index ``begin[chunk]`` on; count them.

    Where ``voxel`` is empty, write the most that there can be to ``counts``, nothing else: one
    kernel, since the code they share takes long to compile. ``distance`` (voxels,) is in voxels to
    the nearest active one, ``number`` (voxels,) negative for inactive ones; empty where all are
    active.
    """
    lower, upper, spacing, shape = box
    cuts, parameters = np.zeros(9 * SLABS), np.zeros((WIDTH, RAYS_TOGETHER))
    starts, stops = np.zeros(RAYS_TOGETHER, np.int64), np.zeros(RAYS_TOGETHER, np.int64)
    for chunk in range(first_chunk, last_chunk):
        at, last = np.uint64(begin[chunk]), min((chunk + 1) * RAYS_A_CHUNK, len(counts))
        for first in range(chunk * RAYS_A_CHUNK, last, RAYS_TOGETHER):
            some = min(RAYS_TOGETHER, last - first)
            set_parameters(
                origins, directions, lengths, first, some, lower, upper, spacing, shape, parameters
            )
            if len(voxel) == 0:
                for k in range(some):
                    counts[first + k] = most_of(parameters, k)
                continue
            set_slabs(parameters, some, distance, starts, stops)
            for k in range(some):
                start, stop, before = starts[k], stops[k], at
                origin, end, a, b, c = parameters_of(parameters, k)
                while start < stop:
                    slabs, found = min(SLABS, stop - start), at
                    _cut(start, origin, a, b, c, end, weights[first + k], cuts)
                    start += slabs
                    if len(middle) > 0:
                        entry, direction = entry_of(parameters, k)
                        pack_middles(
                            slabs, cuts, number, at, entry, direction, spacing, shape, middle
                        )
                    at = pack(slabs, start == stop, cuts, number, at, voxel, length)
                    while len(distance) > 0 and at == found and start < stop:
                        clear = clear_ahead(distance, start, origin, a, b, c, end)
                        if clear == 0:
                            break
                        start += clear
                counts[first + k] = np.int64(at - before)


@compiled()
def _move_down(begin, ptr, words, array, moved):
    """Move the entries from ``begin[chunk]`` on to ``ptr[chunk]:ptr[chunk + 1]``.

    ``array`` and ``moved``, which may be the same, hold entries of so many 32-bit ``words``.
    """
    same = array.ctypes.data == moved.ctypes.data
    some = np.zeros(4096, np.uint32)
    for chunk in range(len(begin)):
        shift = words * (begin[chunk] - ptr[chunk])
        first, last = words * ptr[chunk], words * ptr[chunk + 1]
        if not same:
            for i in range(last - first):
                moved[np.uint64(first + i)] = array[np.uint64(first + shift + i)]
            continue
        for start in range(first, last if shift > 0 else first, len(some)):
            count = min(len(some), last - start)
            for i in range(count):
                some[i] = array[start + shift + i]
            for i in range(count):
                moved[start + i] = some[i]


class March:
    """Traces rays with the compiled walk on all cores, one thread at a time; see `tracing`.

    Where not all voxels are active, most of the room for segments stays empty: it is kept from
    call to call, since new pages from the system cost more than writing to them, and the segments
    are copied out of it.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        *,
        midpoints: bool = False,
        dtype: DTypeLike = np.float32,
        active: ActiveVoxels | None = None,
        in_storage_order: bool = False,
    ) -> None:
        self._box = tuple(grid.lower), tuple(grid.upper), grid.spacing, grid.shape
        self._types = index_type(grid.size), np.dtype(dtype)
        self._midpoints = midpoints
        self._all = active is None or active.all
        self._distance, self._number = np.zeros(0, np.uint8), np.zeros(0, np.int32)
        if active is not None and not active.all:
            self._distance = active.distance.ravel()
            self._number = active.storage_index_of_voxel if in_storage_order else active.number
        self._kept = self._room(0)

    def __call__(self, rays: Rays) -> Segments:
        """Return the segments of rays in active voxels."""
        chunks = np.zeros(-(-len(rays) // RAYS_A_CHUNK), np.int64)
        with threads_worth(_COUNTING * len(rays)):
            most = self._fill(rays, chunks, self._room(0))
        begin, needed = most[:-1:RAYS_A_CHUNK].copy(), int(most[-1])
        room = self._room(needed) if self._all or len(self._kept[0]) < needed else self._kept
        with threads_worth(_FILLING * len(rays)):
            ptr = self._fill(rays, begin, room)
        ends = np.append(ptr[:-1:RAYS_A_CHUNK], ptr[-1])
        if self._all:
            found = room
        else:
            self._kept, found = room, self._room(int(ptr[-1]))
        for spread, closed in zip(room, found, strict=True):
            _close_up(begin, ends, spread, closed)
        voxel, length, middle = (array[: ptr[-1]] for array in found)
        return Segments(ptr[rays.pixel_ptr], voxel, length, middle if self._midpoints else None)

    def _room(self, segments: int) -> tuple[NDArray, ...]:
        """Return memory; pages never written to are never taken from the system."""
        voxel, length = (np.zeros(segments, kind) for kind in self._types)
        return voxel, length, np.zeros((segments * self._midpoints, 3), length.dtype)

    def _fill(
        self, rays: Rays, begin: NDArray[np.int64], room: tuple[NDArray, ...]
    ) -> NDArray[np.int64]:
        """Write the segments to ``room``; return where each ray's begin. See the kernel."""
        counts = np.zeros(len(rays), np.int64)

        def fill(first: int, last: int) -> None:
            _fill(
                rays.origins, rays.directions, rays.lengths, rays.weight,
                self._box, self._distance, self._number, begin, first, last, counts, *room,
            )  # fmt: skip

        run_ranges(len(begin), fill)
        return np.append(0, np.cumsum(counts))


def _close_up(
    begin: NDArray[np.int64], ptr: NDArray[np.int64], spread: NDArray, closed: NDArray
) -> None:
    """Move the entries of all chunks one behind the other."""
    if not len(spread):
        return
    word = np.dtype(np.uint32)
    words = spread[:1].nbytes // word.itemsize
    flat = spread.reshape(-1).view(word), closed.reshape(-1).view(word)
    _move_down(begin, ptr, words, *flat)
