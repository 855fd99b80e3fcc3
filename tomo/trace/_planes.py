"""The course of one ray through the grid, axis by axis, in numbers that never accumulate.

Planes are counted, not added up: the time at which a ray passes its k-th plane of an axis, and how
many planes it has passed at a time, follow from the first plane's distance and the ray's speed.
Time is the world's length along the ray from where it enters the box, so that nothing depends on
how far away the camera is. The steps are those of `tomo.trace.box.enter_box`.
"""

from __future__ import annotations

import numpy as np

from tomo._compile import compiled
from tomo.trace.box import STILL


@compiled(inline=True)
def lesser(a, b):
    """Return the lesser of two numbers; unlike ``min`` without a thought for NaN."""
    return a if a < b else b


@compiled(inline=True)
def greater(a, b):
    """Return the greater of two numbers; unlike ``max`` without a thought for NaN."""
    return a if a > b else b


@compiled(inline=True)
def voxel_units(point, lower, upper, spacing, count):
    """Return one coordinate in voxels, as `tomo.grid.VoxelGrid.to_voxel_units`."""
    position = (point - lower) / spacing
    return lesser(position, count) if point <= upper else position


@compiled(inline=True)
def _clip(position, direction, count, start, stop):
    """Clip the interval ``start, stop`` of a ray to one axis's slab ``0 <= position <= count``."""
    if abs(direction) < STILL:
        if position < 0 or position > count:
            return start, -1.0
        return start, stop
    lower = (0.0 - position) / direction
    upper = (count - position) / direction
    return greater(start, lesser(lower, upper)), lesser(stop, greater(lower, upper))


@compiled(inline=True)
def enter(origin, direction, length, lower, upper, spacing, shape):
    """Return where a ray enters the box, its direction, and its length inside.

    ``x, y, z, dx, dy, dz, end``: in voxels, in voxels per world length, in world length; ``end``
    is not positive where the ray misses.
    """
    x = voxel_units(origin[0], lower[0], upper[0], spacing[0], shape[0])
    y = voxel_units(origin[1], lower[1], upper[1], spacing[1], shape[1])
    z = voxel_units(origin[2], lower[2], upper[2], spacing[2], shape[2])
    dx, dy, dz = direction[0] / spacing[0], direction[1] / spacing[1], direction[2] / spacing[2]
    start, stop = _clip(x, dx, shape[0], 0.0, length)
    start, stop = _clip(y, dy, shape[1], start, stop)
    start, stop = _clip(z, dz, shape[2], start, stop)
    return x + dx * start, y + dy * start, z + dz * start, dx, dy, dz, stop - start


@compiled(inline=True)
def along_axis(position, direction, end, count, stride):
    """Return a ray's course along one axis, whole numbers as floats.

    ``offset``: voxels to the first plane, above 0 and at most 1 where there is one; ``speed``:
    voxels per world length; ``per_plane``: world length per voxel; ``last``: planes ahead inside
    the box; ``first``: the voxel that it moves into; ``step``: +1, -1, or 0 when it stays;
    ``stride``: from one voxel to the next that it enters.

    The outer face is no such plane: the chord of the box ends there, and its length is known from
    outside; found again from within, where rays graze the face, it would be off by rounding.
    """
    if direction == 0 or position + direction * end == position:  # it does not get anywhere
        first = lesser(greater(np.floor(position), 0.0), count - 1)
        return 0.0, 0.0, 1.0, 0.0, first, 0.0, 0.0
    if direction < 0:
        first = lesser(greater(np.ceil(position) - 1, 0.0), count - 1)
        return position - first, -direction, -1 / direction, first, first, -1.0, -stride
    first = lesser(greater(np.floor(position), 0.0), count - 1)
    return first + 1 - position, direction, 1 / direction, count - 1 - first, first, 1.0, stride


@compiled(inline=True)
def course(x, y, z, dx, dy, dz, end, shape):
    """Return the flat number of a ray's first voxel, and its course along each axis.

    The axes are those of `along_axis`, the one along which the ray moves fastest first; ``shape``
    are the numbers of voxels along x, y, z.
    """
    nx, ny, nz = shape
    in_x = along_axis(x, dx, end, nx, ny * nz)
    in_y = along_axis(y, dy, end, ny, nz)
    in_z = along_axis(z, dz, end, nz, 1.0)
    origin = (in_x[4] * ny + in_y[4]) * nz + in_z[4]
    if in_x[1] >= in_y[1] and in_x[1] >= in_z[1]:
        return origin, in_x, in_y, in_z
    if in_y[1] >= in_z[1]:
        return origin, in_y, in_x, in_z
    return origin, in_z, in_x, in_y


@compiled(inline=True)
def passed(time, axis):
    """Return how many planes of an axis a ray has passed at ``time``."""
    offset, speed, last = axis[0], axis[1], axis[3]
    return lesser(greater(np.floor(time * speed - offset) + 1, 0.0), last)


@compiled(inline=True)
def passing(plane, axis):
    """Return when a ray passes a plane of an axis; they are numbered from 0 as it meets them."""
    return (axis[0] + plane) * axis[2]


@compiled(inline=True)
def most_crossings(end, a, b, c):
    """Return how many voxels a ray crosses, edges and corners aside where it crosses fewer."""
    return np.int64(passed(end, a) + passed(end, b) + passed(end, c)) + 1
