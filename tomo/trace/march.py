"""The compiled exact walk: every layer of voxels by itself, several at a time.

A layer lies across the axis along which the ray moves fastest, in voxels. Inside it the ray passes
at most one plane of each other axis, so it meets at most three voxels; where they begin and end
follows from the layer's number alone (`tomo.trace._planes`). Layers are therefore independent: the
loop over them has no branch and is vectorised, and layers in empty space are left out without any
influence on the others. What has no length is dropped when the pieces are packed.

Jacobs et al., "A fast algorithm to calculate the exact radiological path through a pixel or voxel
space" (Journal of Computing and Information Technology 6, 1998) count crossings in the same way.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo._bricks import BRICK_BITS
from tomo._compile import compiled
from tomo.grid import VoxelGrid
from tomo.live_voxels import LiveVoxels
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.trace._collect import voxel_dtype
from tomo.trace._planes import (
    course,
    enter,
    greater,
    lesser,
    most_crossings,
    passed,
    passing,
)

RAYS_A_CHUNK = 256  # one thread's at a time
LANES = 1 << BRICK_BITS  # layers that are cut or skipped at once: a vector of doubles, or some


@compiled(inline=True)
def _cut(start, origin, a, b, c, end, weight, pieces):
    """Cut a ray in `LANES` layers from ``start`` on into three pieces each, some of no length.

    ``pieces`` (9 * LANES,) takes, for all layers each, the lengths times ``weight`` of the first,
    second and third piece, then their voxels, then the times in their middles. One buffer, so
    that the compiler sees that nothing overlaps.
    """
    for i in range(LANES):
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
        first = origin + layer * a[6] + b0 * b[6] + c0 * c[6]
        step_b, step_c = (b1 - b0) * b[6], (c1 - c0) * c[6]
        pieces[i] = (sooner - into) * weight
        pieces[LANES + i] = (later - sooner) * weight
        pieces[2 * LANES + i] = (out - later) * weight
        pieces[3 * LANES + i] = first
        pieces[4 * LANES + i] = first + (step_b if at_b < at_c else step_c)
        pieces[5 * LANES + i] = first + step_b + step_c
        pieces[6 * LANES + i] = (into + sooner) / 2
        pieces[7 * LANES + i] = (sooner + later) / 2
        pieces[8 * LANES + i] = (later + out) / 2


@compiled(inline=True)
def _renumber(layers, number, pieces):
    """Put the numbers of the live voxels in place of voxels; other voxels' pieces vanish."""
    for piece in range(3):
        for layer in range(piece * LANES, piece * LANES + layers):
            found = number[np.int64(pieces[3 * LANES + layer])]
            pieces[3 * LANES + layer] = found
            if found < 0:
                pieces[layer] = 0.0


@compiled(inline=True)
def _pack(layers, is_end, pieces, at, voxel, length):
    """Write the pieces that have a length from index ``at`` on; return where they end.

    What has none is overwritten by what comes next, without a branch; nothing need come after
    the last layer of a run.
    """
    for layer in range(layers - 1 if is_end else layers):
        for piece in range(2):
            found = pieces[np.uint64(piece * LANES + layer)]
            voxel[at] = np.int64(pieces[np.uint64((3 + piece) * LANES + layer)])
            length[at] = found
            at += np.uint64(found > 0)
        if pieces[np.uint64(2 * LANES + layer)] > 0:  # rare
            voxel[at] = np.int64(pieces[np.uint64(5 * LANES + layer)])
            length[at] = pieces[np.uint64(2 * LANES + layer)]
            at += np.uint64(1)
    if is_end:
        for piece in range(3):
            found = pieces[np.uint64(piece * LANES + layers - 1)]
            if found > 0:
                voxel[at] = np.int64(pieces[np.uint64((3 + piece) * LANES + layers - 1)])
                length[at] = found
                at += np.uint64(1)
    return at


@compiled(inline=True)
def _pack_middles(layers, pieces, at, entry, direction, spacing, middle):
    """Write the middles of the pieces that `_pack` keeps."""
    for layer in range(layers):
        for piece in range(3):
            if pieces[piece * LANES + layer] > 0:
                time = pieces[(6 + piece) * LANES + layer]
                for axis in range(3):
                    middle[at, axis] = (entry[axis] + direction[axis] * time) * spacing[axis]
                at += np.uint64(1)


@compiled(inline=True)
def _end_of_run(start, all_layers, a, occupied):
    """Return where the layers end that are cut or skipped with ``start``.

    They are at most `LANES`, and in the same layer of bricks where bricks are skipped.
    """
    run = LANES
    if len(occupied) > 0:
        in_brick = np.int64(a[4] + a[5] * start) & (LANES - 1)
        run = LANES - in_brick if a[5] > 0 else in_brick + 1
    return min(start + run, all_layers)


@compiled(inline=True)
def _bricks_between(into, out, axis):
    """Return the first and last brick along an axis that a ray meets between two times."""
    near = np.int64(axis[4] + axis[5] * passed(into, axis)) >> BRICK_BITS
    far = np.int64(axis[4] + axis[5] * passed(out, axis)) >> BRICK_BITS
    return min(near, far), max(near, far)


@compiled(inline=True)
def _may_be_live(start, stop, a, b, c, end, occupied):
    """Say whether a ray may meet a live voxel in the layers ``start:stop`` of one brick along a.

    ``occupied`` (bricks,) says which bricks hold one; where it is empty, all do.
    """
    if len(occupied) == 0:
        return True
    into = lesser(greater(passing(start - 1.0, a), 0.0), end)
    out = lesser(passing(stop - 1.0, a), end) if stop - 1 < a[3] else end
    low_b, high_b = _bricks_between(into, out, b)
    low_c, high_c = _bricks_between(into, out, c)
    row = (np.int64(a[4] + a[5] * start) >> BRICK_BITS) * a[7]
    for in_b in range(low_b, high_b + 1):
        for in_c in range(low_c, high_c + 1):
            if occupied[row + in_b * b[7] + in_c * c[7]]:
                return True
    return False


@compiled(parallel=True)
def _fill(
    origins, directions, lengths, weights, box, occupied, number, begin,
    counts, voxel, length, middle,
):  # fmt: skip
    """Write the crossings of every chunk of rays from index ``begin[chunk]`` on; count them.

    Where ``voxel`` has no room, write to ``counts`` how many there can be at most, and no more:
    in one kernel with the other, for what both need takes long to compile.
    """
    lower, upper, spacing, shape, bricks = box
    half = (shape[0] / 2, shape[1] / 2, shape[2] / 2)
    for chunk in numba.prange(len(begin)):
        pieces = np.zeros(9 * LANES)
        at = np.uint64(begin[chunk])
        for ray in range(chunk * RAYS_A_CHUNK, min((chunk + 1) * RAYS_A_CHUNK, len(counts))):
            x, y, z, dx, dy, dz, end = enter(
                origins[ray], directions[ray], lengths[ray], lower, upper, spacing, shape
            )
            if not end > 0:
                continue
            origin, a, b, c = course(x, y, z, dx, dy, dz, end, shape, bricks)
            if len(voxel) == 0:
                counts[ray] = most_crossings(end, a, b, c)
                continue
            entry, direction = (x - half[0], y - half[1], z - half[2]), (dx, dy, dz)
            before, start, all_layers = at, np.int64(0), np.int64(passed(end, a)) + 1
            while start < all_layers:
                first, start = start, _end_of_run(start, all_layers, a, occupied)
                if not _may_be_live(first, start, a, b, c, end, occupied):
                    continue
                _cut(first, origin, a, b, c, end, weights[ray], pieces)
                if len(number) > 0:
                    _renumber(start - first, number, pieces)
                if len(middle) > 0:
                    _pack_middles(start - first, pieces, at, entry, direction, spacing, middle)
                at = _pack(start - first, start == all_layers, pieces, at, voxel, length)
            counts[ray] = np.int64(at - before)


@compiled()
def _move_down(begin, ptr, words, array):
    """Move what stands from ``begin[chunk]`` on to ``ptr[chunk]:ptr[chunk + 1]``.

    Parameters
    ----------
    begin : (chunks,) int64
    ptr : (chunks + 1,) int64
    words : int
        Of 32 bits, that an entry of the array has.
    array : uint32
    """
    some = np.zeros(4096, np.uint32)
    for chunk in range(len(begin)):
        shift = words * (begin[chunk] - ptr[chunk])
        if shift == 0:
            continue
        last = words * ptr[chunk + 1]
        for start in range(words * ptr[chunk], last, len(some)):
            count = min(len(some), last - start)
            for i in range(count):
                some[i] = array[start + shift + i]
            for i in range(count):
                array[start + i] = some[i]


def trace(
    rays: Rays,
    grid: VoxelGrid,
    *,
    midpoints: bool = False,
    dtype: DTypeLike = np.float32,
    live: LiveVoxels | None = None,
) -> Segments:
    """Trace rays with the compiled walk on all cores; see `tomo.trace.trace`."""
    occupied, number = np.zeros((0, 0, 0), np.bool_), np.zeros(0, np.int32)
    if live is not None and not live.all:
        occupied, number = live.bricks, live.number
    lines = rays.origins, rays.directions, rays.lengths
    box = tuple(grid.lower), tuple(grid.upper), grid.spacing, grid.shape, occupied.shape

    def filled(room: int, begin: NDArray[np.int64]) -> tuple[NDArray, ...]:
        # Pages that nothing is written to are never taken from the system.
        voxel = np.zeros(room, voxel_dtype(grid))
        length = np.zeros(room, dtype)
        middle = np.zeros((room if midpoints else 0, 3), dtype)
        counts = np.zeros(len(rays), np.int64)
        _fill(
            *lines, rays.weight, box, occupied.ravel(), number, begin, counts,
            voxel, length, middle,
        )  # fmt: skip
        return np.append(0, np.cumsum(counts)), voxel, length, middle

    most, *_ = filled(0, np.zeros(-(-len(rays) // RAYS_A_CHUNK), np.int64))
    begin = most[:-1:RAYS_A_CHUNK].copy()
    ptr, voxel, length, middle = filled(int(most[-1]), begin)
    ends = np.append(ptr[:-1:RAYS_A_CHUNK], ptr[-1])
    voxel = _closed_up(begin, ends, voxel)
    length = _closed_up(begin, ends, length)
    middle = _closed_up(begin, ends, middle) if midpoints else None
    return Segments(ptr[rays.pixel_ptr], voxel, length, middle)


def _closed_up(begin: NDArray[np.int64], ptr: NDArray[np.int64], array: NDArray) -> NDArray:
    """Return the entries of all chunks one behind the other."""
    word = np.dtype(np.uint32)
    words = array[:1].nbytes // word.itemsize
    _move_down(begin, ptr, words, array.reshape(-1).view(word))
    found = array[: ptr[-1]]
    return found if len(found) > 0.9 * len(array) else found.copy()
