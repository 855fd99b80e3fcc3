"""Where one ray passes the planes between voxels, axis by axis; nothing accumulates.

Planes are counted, not added up: when a ray passes its k-th plane of an axis, and how many planes
it has passed at a time, follow from the first plane's distance and the ray's speed. Time is the
world length along the ray from its entry into the box, so that nothing depends on how far away the
camera is. The steps are those of `tomo.rays.ray_box.enter_box`. Nothing branches on data: loops
over rays vectorise.

Some rays are set up at once: their parameters take divisions, and reading the distance to the
nearest active voxel waits for memory.
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


RAYS_TOGETHER = 16
"""Rays set up at once: fewer wait for divisions and memory, more leave the nearest cache."""

_ORIGIN, _END, _SLABS, _MOST = range(4)
_A, _B, _C, _ENTRY = range(4, 20, 5)  # five numbers an axis
_DIRECTION, _LENGTH = range(_ENTRY + 3, _ENTRY + 7, 3)

WIDTH = _LENGTH + 1
"""Numbers kept for a ray."""


@compiled(inline=True)
def set_parameters(
    origins, directions, lengths, first, some, lower, upper, spacing, shape, parameters
) -> None:  # fmt: skip
    """Write the parameters of ``some`` rays from ``first`` on, one column each.

    ``parameters`` (WIDTH, RAYS_TOGETHER) float64 are read by `set_slabs`, `most_of`,
    `parameters_of` and `entry_of`.
    """
    for k in range(some):
        for axis in range(3):
            parameters[_ENTRY + axis, k] = origins[first + k, axis]
            parameters[_DIRECTION + axis, k] = directions[first + k, axis]
        parameters[_LENGTH, k] = lengths[first + k]
    nx, ny, nz = float(shape[0]), float(shape[1]), float(shape[2])
    for k in range(RAYS_TOGETHER):
        x, y, z, dx, dy, dz, end = enter(
            *entry_of(parameters, k),
            parameters[_LENGTH, k], lower, upper, spacing, (nx, ny, nz),
        )  # fmt: skip
        parameters[_ENTRY, k], parameters[_DIRECTION, k] = x, dx
        parameters[_ENTRY + 1, k], parameters[_DIRECTION + 1, k] = y, dy
        parameters[_ENTRY + 2, k], parameters[_DIRECTION + 2, k] = z, dz
        in_x = along_axis(x, dx, end, nx, ny * nz)
        in_y = along_axis(y, dy, end, ny, nz)
        in_z = along_axis(z, dz, end, nz, 1.0)
        is_x = (in_x[1] >= in_y[1]) & (in_x[1] >= in_z[1])
        is_z = (not is_x) & (in_y[1] < in_z[1])
        a, b, c = _fastest_first(is_x, is_z, in_x, in_y, in_z)
        _write(parameters, _A, k, a)
        _write(parameters, _B, k, b)
        _write(parameters, _C, k, c)
        planes = passed(end, a)
        parameters[_ORIGIN, k] = (in_x[5] * ny + in_y[5]) * nz + in_z[5]
        parameters[_END, k] = end
        parameters[_SLABS, k] = planes + 1 if end > 0 else 0.0
        parameters[_MOST, k] = planes + passed(end, b) + passed(end, c) + 1 if end > 0 else 0.0


@compiled(inline=True)
def _fastest_first(is_x, is_z, in_x, in_y, in_z):
    """Return a ray's parameters along the axes, the driving axis first."""
    return (
        _one_of(is_x, in_x, _one_of(is_z, in_z, in_y)),
        _one_of(is_x, in_y, in_x),
        _one_of(is_z, in_y, in_z),
    )


@compiled(inline=True)
def _one_of(is_one, one, other):
    """Return the parameters of one of two axes, all but the first voxel."""
    return (
        one[0] if is_one else other[0],
        one[1] if is_one else other[1],
        one[2] if is_one else other[2],
        one[3] if is_one else other[3],
        one[4] if is_one else other[4],
    )


@compiled(inline=True)
def _write(parameters, row, k, axis):
    parameters[row, k], parameters[row + 1, k], parameters[row + 2, k] = axis[0], axis[1], axis[2]
    parameters[row + 3, k], parameters[row + 4, k] = axis[3], axis[4]


@compiled(inline=True)
def _read(parameters, row, k):
    return (
        parameters[row, k],
        parameters[row + 1, k],
        parameters[row + 2, k],
        parameters[row + 3, k],
        parameters[row + 4, k],
    )


@compiled(inline=True)
def parameters_of(parameters, k) -> tuple:
    """Return a ray's first voxel, its length in the box, and its parameters along each axis.

    The voxel is its flat index as a float; the axes are those of `along_axis`, the driving axis
    first.
    """
    k = np.uint64(k)
    a, b, c = _read(parameters, _A, k), _read(parameters, _B, k), _read(parameters, _C, k)
    return parameters[_ORIGIN, k], parameters[_END, k], a, b, c


@compiled(inline=True)
def entry_of(parameters, k) -> tuple:
    """Return where a ray enters the box, and its direction, in voxels and per world length."""
    return (
        (parameters[_ENTRY, k], parameters[_ENTRY + 1, k], parameters[_ENTRY + 2, k]),
        (parameters[_DIRECTION, k], parameters[_DIRECTION + 1, k], parameters[_DIRECTION + 2, k]),
    )


@compiled(inline=True)
def most_of(parameters, k) -> np.int64:
    """Return the most segments of a ray; it has fewer where it passes edges or corners."""
    return np.int64(parameters[_MOST, k])


@compiled(inline=True)
def _clear(distance, time, slab, origin, a, b, c):
    """Return how many slabs, either way from a point of a ray, hold no active voxel on it.

    After n slabs the ray is within n + 1 voxels, n + 2 with rounding.
    """
    voxel = np.int64(origin + slab * a[4] + passed(time, b) * b[4] + passed(time, c) * c[4])
    return max(np.int64(distance[np.uint64(voxel)]) - 2, 0)


@compiled(inline=True)
def clear_ahead(distance, start, origin, a, b, c, end) -> int:
    """Return a number of slabs from ``start`` on that hold no active voxel on a ray."""
    into = lesser(greater(passing(start - 1.0, a), 0.0), end)
    return _clear(distance, into, float(start), origin, a, b, c)


@compiled(inline=True)
def _clear_behind(distance, stop, origin, a, b, c, end):
    """Return a number of slabs before ``stop`` that hold no active voxel on a ray."""
    slab = stop - 1.0
    out = lesser(passing(slab, a), end) if slab < a[3] else end
    return _clear(distance, out, slab, origin, a, b, c)


@compiled(inline=True)
def set_slabs(parameters, some, distance, starts, stops) -> None:
    """Write between which slabs each ray can meet an active voxel, ``(RAYS_TOGETHER,)``.

    ``distance`` (voxels,) uint8 is in voxels to the nearest active one; empty where all are.
    """
    for k in range(some):
        starts[k], stops[k] = 0, np.int64(parameters[_SLABS, k])
    moved = len(distance) > 0
    while moved:
        moved = False
        for k in range(some):
            if starts[k] < stops[k]:
                origin, end, a, b, c = parameters_of(parameters, k)
                clear = clear_ahead(distance, starts[k], origin, a, b, c, end)
                starts[k] += clear
                moved |= clear > 0
    moved = len(distance) > 0
    while moved:
        moved = False
        for k in range(some):
            if starts[k] < stops[k]:
                origin, end, a, b, c = parameters_of(parameters, k)
                clear = _clear_behind(distance, stops[k], origin, a, b, c, end)
                stops[k] -= clear
                moved |= clear > 0
