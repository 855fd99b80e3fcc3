"""Some rays at once: their way through the grid, and the layers to look for active voxels in.

What a ray's course takes are divisions, and a look at how far the nearest active voxel is waits
for the memory: both take a fraction of the time where the processor has several rays at hand.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.trace.plane_crossings import along_axis, enter, greater, lesser, passed, passing

RAYS_TOGETHER = 16

WIDTH = 26
"""Numbers kept for a ray."""

_ORIGIN, _END, _LAYERS, _MOST = range(4)
_A, _B, _C = 4, 9, 14
_ENTRY, _DIRECTION, _LENGTH = 19, 22, 25


@compiled(inline=True)
def set_courses(
    origins, directions, lengths, first, some, lower, upper, spacing, shape, courses
):  # fmt: skip
    """Write the courses of ``some`` rays from ``first`` on, side by side.

    Parameters
    ----------
    origins, directions, lengths
        As in `tomo.rays.Rays`.
    first, some : int
    lower, upper, spacing, shape : tuple
        Of the grid.
    courses : (WIDTH, RAYS_TOGETHER) float64
        Written; read by `set_layers`, `most_of`, `course_of` and `entry_of`.
    """
    for k in range(some):
        for axis in range(3):
            courses[_ENTRY + axis, k] = origins[first + k, axis]
            courses[_DIRECTION + axis, k] = directions[first + k, axis]
        courses[_LENGTH, k] = lengths[first + k]
    nx, ny, nz = float(shape[0]), float(shape[1]), float(shape[2])
    for k in range(RAYS_TOGETHER):
        x, y, z, dx, dy, dz, end = enter(
            (courses[_ENTRY, k], courses[_ENTRY + 1, k], courses[_ENTRY + 2, k]),
            (courses[_DIRECTION, k], courses[_DIRECTION + 1, k], courses[_DIRECTION + 2, k]),
            courses[_LENGTH, k], lower, upper, spacing, (nx, ny, nz),
        )  # fmt: skip
        courses[_ENTRY, k], courses[_DIRECTION, k] = x, dx
        courses[_ENTRY + 1, k], courses[_DIRECTION + 1, k] = y, dy
        courses[_ENTRY + 2, k], courses[_DIRECTION + 2, k] = z, dz
        in_x = along_axis(x, dx, end, nx, ny * nz)
        in_y = along_axis(y, dy, end, ny, nz)
        in_z = along_axis(z, dz, end, nz, 1.0)
        is_x = (in_x[1] >= in_y[1]) & (in_x[1] >= in_z[1])
        is_z = (not is_x) & (in_y[1] < in_z[1])
        a, b, c = _fastest_first(is_x, is_z, in_x, in_y, in_z)
        _write(courses, _A, k, a)
        _write(courses, _B, k, b)
        _write(courses, _C, k, c)
        planes = passed(end, a)
        courses[_ORIGIN, k] = (in_x[5] * ny + in_y[5]) * nz + in_z[5]
        courses[_END, k] = end
        courses[_LAYERS, k] = planes + 1 if end > 0 else 0.0
        courses[_MOST, k] = planes + passed(end, b) + passed(end, c) + 1 if end > 0 else 0.0


@compiled(inline=True)
def _fastest_first(is_x, is_z, in_x, in_y, in_z):
    """Return a ray's courses along the axes, that along which it moves fastest first."""
    return (
        _one_of(is_x, in_x, _one_of(is_z, in_z, in_y)),
        _one_of(is_x, in_y, in_x),
        _one_of(is_z, in_y, in_z),
    )


@compiled(inline=True)
def _one_of(is_one, one, other):
    """Return one of two axes, all but the voxel that a ray moves into."""
    return (
        one[0] if is_one else other[0],
        one[1] if is_one else other[1],
        one[2] if is_one else other[2],
        one[3] if is_one else other[3],
        one[4] if is_one else other[4],
    )


@compiled(inline=True)
def _write(courses, row, k, axis):
    courses[row, k], courses[row + 1, k], courses[row + 2, k] = axis[0], axis[1], axis[2]
    courses[row + 3, k], courses[row + 4, k] = axis[3], axis[4]


@compiled(inline=True)
def _read(courses, row, k):
    return (
        courses[row, k],
        courses[row + 1, k],
        courses[row + 2, k],
        courses[row + 3, k],
        courses[row + 4, k],
    )


@compiled(inline=True)
def course_of(courses, k):
    """Return a ray's first voxel, its length in the box, and its course along each axis.

    The voxel is its flat number as a float; the axes are those of `along_axis`, the one along
    which the ray moves fastest first.
    """
    k = np.uint64(k)
    a, b, c = _read(courses, _A, k), _read(courses, _B, k), _read(courses, _C, k)
    return courses[_ORIGIN, k], courses[_END, k], a, b, c


@compiled(inline=True)
def entry_of(courses, k):
    """Return where a ray enters the box, and its direction, in voxels and per world length."""
    return (
        (courses[_ENTRY, k], courses[_ENTRY + 1, k], courses[_ENTRY + 2, k]),
        (courses[_DIRECTION, k], courses[_DIRECTION + 1, k], courses[_DIRECTION + 2, k]),
    )


@compiled(inline=True)
def most_of(courses, k):
    """Return how many voxels a ray crosses, edges and corners aside where it crosses fewer."""
    return np.int64(courses[_MOST, k])


@compiled(inline=True)
def _clear(away, time, layer, origin, a, b, c):
    """Return how many layers a ray can go, either way, from where it is in a layer.

    n layers on it is within n + 1 voxels, in rounding's doubt n + 2.
    """
    voxel = np.int64(origin + layer * a[4] + passed(time, b) * b[4] + passed(time, c) * c[4])
    return max(np.int64(away[np.uint64(voxel)]) - 2, 0)


@compiled(inline=True)
def clear_ahead(away, start, origin, a, b, c, end):
    """Return how many layers from ``start`` on, at least, hold no active voxel on a ray."""
    into = lesser(greater(passing(start - 1.0, a), 0.0), end)
    return _clear(away, into, float(start), origin, a, b, c)


@compiled(inline=True)
def _clear_behind(away, stop, origin, a, b, c, end):
    """Return how many layers before ``stop``, at least, hold no active voxel on a ray."""
    layer = stop - 1.0
    out = lesser(passing(layer, a), end) if layer < a[3] else end
    return _clear(away, out, layer, origin, a, b, c)


@compiled(inline=True)
def set_layers(courses, some, away, starts, stops):
    """Write between which layers of each ray there can be a active voxel.

    Parameters
    ----------
    courses : (WIDTH, RAYS_TOGETHER) float64
    some : int
        Rays.
    away : (voxels,) uint8
        How far each voxel is from the nearest active one; nothing where all are active.
    starts, stops : (RAYS_TOGETHER,) int64
        Written.
    """
    for k in range(some):
        starts[k], stops[k] = 0, np.int64(courses[_LAYERS, k])
    moved = len(away) > 0
    while moved:
        moved = False
        for k in range(some):
            if starts[k] < stops[k]:
                origin, end, a, b, c = course_of(courses, k)
                clear = clear_ahead(away, starts[k], origin, a, b, c, end)
                starts[k] += clear
                moved |= clear > 0
    moved = len(away) > 0
    while moved:
        moved = False
        for k in range(some):
            if starts[k] < stops[k]:
                origin, end, a, b, c = course_of(courses, k)
                clear = _clear_behind(away, stops[k], origin, a, b, c, end)
                stops[k] -= clear
                moved |= clear > 0
