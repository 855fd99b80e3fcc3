"""The compiled exact walk: every layer of voxels by itself, several at a time.

A layer lies across the axis along which the ray moves fastest, in voxels. Inside it the ray passes
at most one plane of each other axis, so it meets at most three voxels; where they begin and end
follows from the layer's number alone (`tomo.trace.plane_crossings`). Layers are therefore
independent: the loop over them has no branch and is vectorised, and layers in empty space are left
out without any influence on the others: as many as the ray's voxel is away from the nearest active
one, at both ends of the ray before any is cut. What has no length is dropped when the pieces are
packed.

Jacobs et al., "A fast algorithm to calculate the exact radiological path through a pixel or voxel
space" (Journal of Computing and Information Technology 6, 1998) count crossings in the same way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._compute.index_types import numbering
from tomo._compute.jit import compiled
from tomo._compute.threads import share_range, threads_worth
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.rays import Rays
from tomo.trace._packing import SLABS, pack, pack_middles
from tomo.trace._ray_setup import (
    RAYS_TOGETHER,
    WIDTH,
    clear_ahead,
    course_of,
    entry_of,
    most_of,
    set_courses,
    set_layers,
)
from tomo.trace.plane_crossings import greater, lesser, passed, passing
from tomo.trace.segments import Segments

RAYS_A_CHUNK = 256  # one thread's at a time

_COUNTING, _FILLING = 15.0, 150.0  # nanoseconds that a ray takes at least


@compiled(inline=True)
def _cut(start, origin, a, b, c, end, weight, pieces):
    """Cut a ray in `SLABS` layers from ``start`` on into three pieces each, some of no length.

    ``pieces`` (9 * SLABS,) takes, for all layers each, the lengths times ``weight`` of the first,
    second and third piece, then their voxels, then the times in their middles. One buffer, so
    that the compiler sees that nothing overlaps.
    """
    for i in range(SLABS):
        layer = float(start + i)
        into = lesser(greater(passing(layer - 1, a), 0.0), end)
        out = lesser(passing(layer, a), end) if layer < a[3] else end
        # Rounding may see two planes passed where there is one: the second comes a layer later.
        b0 = passed(into, b)
        b1 = lesser(greater(passed(out, b), b0), b0 + 1)
        c0 = passed(into, c)
        c1 = lesser(greater(passed(out, c), c0), c0 + 1)
        at_b = lesser(greater(passing(b0, b), into), out) if b1 > b0 else out
        at_c = lesser(greater(passing(c0, c), into), out) if c1 > c0 else out
        sooner, later = lesser(at_b, at_c), greater(at_b, at_c)
        first = origin + layer * a[4] + b0 * b[4] + c0 * c[4]
        step_b, step_c = (b1 - b0) * b[4], (c1 - c0) * c[4]
        pieces[i] = (sooner - into) * weight
        pieces[SLABS + i] = (later - sooner) * weight
        pieces[2 * SLABS + i] = (out - later) * weight
        pieces[3 * SLABS + i] = first
        pieces[4 * SLABS + i] = first + (step_b if at_b < at_c else step_c)
        pieces[5 * SLABS + i] = first + step_b + step_c
        pieces[6 * SLABS + i] = (into + sooner) / 2
        pieces[7 * SLABS + i] = (sooner + later) / 2
        pieces[8 * SLABS + i] = (later + out) / 2


@compiled()
def _fill(
    origins, directions, lengths, weights, box, away, number, begin, first_chunk, last_chunk,
    counts, voxel, length, middle,
):  # fmt: skip
    """Write the crossings of some chunks of rays, each from index ``begin[chunk]`` on; count them.

    Where ``voxel`` has no room, write to ``counts`` how many there can be at most, and no more:
    in one kernel with the other, for what both need takes long to compile.

    Parameters
    ----------
    origins, directions, lengths, weights
        As in `tomo.rays.Rays`.
    box : tuple
        The grid's lower and upper corner, its spacing and its shape.
    away : (voxels,) uint8
        How far each voxel is from the nearest active one; nothing where all are active.
    number : (voxels,) int
        The number of each active voxel, negative for others; nothing where all are active.
    begin : (chunks,) int64
    first_chunk, last_chunk : int
        Which chunks, the last excluded.
    counts : (rays,) int64
    voxel, length : (room,)
    middle : (room or 0, 3)
    """
    lower, upper, spacing, shape = box
    pieces, courses = np.zeros(9 * SLABS), np.zeros((WIDTH, RAYS_TOGETHER))
    starts, stops = np.zeros(RAYS_TOGETHER, np.int64), np.zeros(RAYS_TOGETHER, np.int64)
    for chunk in range(first_chunk, last_chunk):
        at, last = np.uint64(begin[chunk]), min((chunk + 1) * RAYS_A_CHUNK, len(counts))
        for first in range(chunk * RAYS_A_CHUNK, last, RAYS_TOGETHER):
            some = min(RAYS_TOGETHER, last - first)
            set_courses(
                origins, directions, lengths, first, some, lower, upper, spacing, shape, courses
            )
            if len(voxel) == 0:
                for k in range(some):
                    counts[first + k] = most_of(courses, k)
                continue
            set_layers(courses, some, away, starts, stops)
            for k in range(some):
                start, stop, before = starts[k], stops[k], at
                origin, end, a, b, c = course_of(courses, k)
                while start < stop:
                    layers, found = min(SLABS, stop - start), at
                    _cut(start, origin, a, b, c, end, weights[first + k], pieces)
                    start += layers
                    if len(middle) > 0:
                        entry, direction = entry_of(courses, k)
                        pack_middles(
                            layers, pieces, number, at, entry, direction, spacing, shape, middle
                        )
                    at = pack(layers, start == stop, pieces, number, at, voxel, length)
                    while len(away) > 0 and at == found and start < stop:
                        clear = clear_ahead(away, start, origin, a, b, c, end)
                        if clear == 0:
                            break
                        start += clear
                counts[first + k] = np.int64(at - before)


@compiled()
def _move_down(begin, ptr, words, array, moved):
    """Write what stands from ``begin[chunk]`` on to ``ptr[chunk]:ptr[chunk + 1]``.

    Parameters
    ----------
    begin : (chunks,) int64
    ptr : (chunks + 1,) int64
    words : int
        Of 32 bits, that an entry of the array has.
    array, moved : uint32
        Where it stands and where it is written to; the same for what is not to be copied.
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
    """Traces rays with the compiled walk on all cores.

    Where not all voxels are active most of the room for crossings stays empty: it is kept from
    call to call, as pages new from the system cost more than what is written to them, and what was
    found is copied out of it. One thread may call it at a time.

    Parameters
    ----------
    grid, midpoints, dtype, active, in_storage_order
        See `tomo.trace.tracing`.
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
        self._types = numbering(grid.size), np.dtype(dtype)
        self._midpoints = midpoints
        self._all = active is None or active.all
        self._away, self._number = np.zeros(0, np.uint8), np.zeros(0, np.int32)
        if not self._all:
            self._away = active.clearance.ravel()
            self._number = active.storage_index_of_voxel if in_storage_order else active.number
        self._kept = self._room(0)

    def __call__(self, rays: Rays) -> Segments:
        """Return the crossings of rays with active voxels."""
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

    def _room(self, crossings: int) -> tuple[NDArray, ...]:
        """Return memory; pages that nothing is written to are never taken from the system."""
        voxel, length = (np.zeros(crossings, kind) for kind in self._types)
        return voxel, length, np.zeros((crossings * self._midpoints, 3), length.dtype)

    def _fill(
        self, rays: Rays, begin: NDArray[np.int64], room: tuple[NDArray, ...]
    ) -> NDArray[np.int64]:
        """Write the crossings to room, return where each ray's begin; see the kernel."""
        counts = np.zeros(len(rays), np.int64)

        def fill(first: int, last: int) -> None:
            _fill(
                rays.origins, rays.directions, rays.lengths, rays.weight,
                self._box, self._away, self._number, begin, first, last, counts, *room,
            )  # fmt: skip

        share_range(len(begin), fill)
        return np.append(0, np.cumsum(counts))


def _close_up(
    begin: NDArray[np.int64], ptr: NDArray[np.int64], spread: NDArray, closed: NDArray
) -> None:
    """Write the entries of all chunks one behind the other."""
    if not len(spread):
        return
    word = np.dtype(np.uint32)
    words = spread[:1].nbytes // word.itemsize
    flat = spread.reshape(-1).view(word), closed.reshape(-1).view(word)
    _move_down(begin, ptr, words, *flat)
