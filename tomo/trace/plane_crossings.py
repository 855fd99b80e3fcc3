"""Where one ray passes the planes between voxels, axis by axis; nothing accumulates.

Planes are counted, not added up: when a ray passes its k-th plane of an axis, and how many planes
it has passed at a time, follow from the first plane's distance and the ray's speed. Time is the
world length along the ray from its entry into the box, so that nothing depends on how far away the
camera is. The steps are those of `tomo.rays.ray_box.enter_box`. Nothing branches on data: loops
over rays vectorise.
"""

from __future__ import annotations

import numpy as np

from tomo._compute.jit import compiled
from tomo.rays.ray_box import STILL


@compiled(inline=True)
def lesser(a: float, b: float) -> float:
    """Return the lesser of two numbers; unlike ``min`` not for NaN."""
    return a if a < b else b


@compiled(inline=True)
def greater(a: float, b: float) -> float:
    """Return the greater of two numbers; unlike ``max`` not for NaN."""
    return a if a > b else b


@compiled(inline=True)
def voxel_units(point: float, lower: float, upper: float, spacing: float, count: int) -> float:
    """Return one coordinate in voxels, as `tomo.grid.VoxelGrid.to_voxel_units`."""
    position = (point - lower) / spacing
    return lesser(position, count) if point <= upper else position


@compiled(inline=True)
def _clip(position, direction, count, start, stop):
    """Clip the interval ``start, stop`` of a ray to one axis's slab ``0 <= position <= count``."""
    still = abs(direction) < STILL
    outside = (position < 0) | (position > count)
    lower = (0.0 - position) / direction
    upper = (count - position) / direction
    near = greater(start, lesser(lower, upper))
    far = lesser(stop, greater(lower, upper))
    return (start if still else near), ((-1.0 if outside else stop) if still else far)


@compiled(inline=True)
def enter(origin, direction, length, lower, upper, spacing, shape) -> tuple:
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
def along_axis(position, direction, end, count, stride) -> tuple:
    """Return a ray's parameters along one axis, integers as floats.

    ``offset``: voxels to the first plane, above 0 and at most 1 where there is one; ``speed``:
    voxels per world length; ``per_plane``: world length per voxel; ``last``: planes ahead inside
    the box; ``stride``: from one voxel to the next that it enters, 0 where it stays; ``first``:
    the voxel that it moves into.

    The outer face is not counted: the ray's length in the box ends there and is known from
    `enter`; computed again from inside it would be off by rounding where rays graze the face.
    """
    still = (direction == 0) | (position + direction * end == position)  # gets nowhere
    back = (direction < 0) & (not still)
    first = np.ceil(position) - 1 if back else np.floor(position)
    first = lesser(greater(first, 0.0), count - 1)
    offset = position - first if back else first + 1 - position
    speed, ahead = abs(direction), first if back else count - 1 - first
    stride = -stride if back else stride
    return (
        0.0 if still else offset,
        0.0 if still else speed,
        1.0 if still else 1 / speed,
        0.0 if still else ahead,
        0.0 if still else stride,
        first,
    )


@compiled(inline=True)
def passed(time: float, axis: tuple) -> float:
    """Return how many planes of an axis a ray has passed at ``time``."""
    offset, speed, last = axis[0], axis[1], axis[3]
    return lesser(greater(np.floor(time * speed - offset) + 1, 0.0), last)


@compiled(inline=True)
def passing(plane: float, axis: tuple) -> float:
    """Return when a ray passes a plane of an axis; they are numbered from 0 as it meets them."""
    return (axis[0] + plane) * axis[2]
