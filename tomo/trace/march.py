"""The compiled exact walk: count the crossings of every ray, then fill them in.

Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing" (Eurographics 1987), with
one change: the distance to a plane is computed from the plane's number, never accumulated, so no
error builds up along a ray.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import DTypeLike

from tomo._compile import compiled
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.trace._collect import voxel_dtype


@compiled(inline=True)
def _first_voxel(position, direction, count):
    """Return the voxel a ray at ``position`` moves into, and the step to the next one."""
    if direction < 0:
        voxel, step = math.ceil(position) - 1, -1
    else:
        voxel, step = math.floor(position), (1 if direction > 0 else 0)
    return min(max(int(voxel), 0), count - 1), step


@compiled(inline=True)
def _distance_to_next(voxel, step, position, direction, count):
    """Return how far along the ray the face lies through which it enters the next voxel.

    The outer face is no such face: the chord of the box ends there, and its length is known from
    outside; found again from within, where rays graze the face, it would be off by rounding.
    """
    if step == 0 or voxel + step < 0 or voxel + step >= count:
        return np.inf
    face = voxel + 1 if step > 0 else voxel
    return (face - position) / direction


@compiled(inline=True)
def _clip(position, direction, count, start, stop):
    """Clip the interval ``start, stop`` of a ray to one axis's slab ``0 <= position <= count``."""
    if direction == 0:
        if position < 0 or position > count:
            return start, -1.0
        return start, stop
    lower = (0.0 - position) / direction
    upper = (count - position) / direction
    return max(start, min(lower, upper)), min(stop, max(lower, upper))


@compiled(inline=True)
def _moving(position, direction, length):
    """Return ``direction``, or zero when the ray stays at ``position`` all along ``length``."""
    return 0.0 if position + direction * length == position else direction


@compiled()
def _walk(origin, direction, stop, shape, weight, at, voxel, length, middle):
    """Walk one ray; write its crossings from index ``at`` on, or only count them when ``at < 0``.

    ``origin`` is in voxel units from the lower corner, ``direction`` in voxels per unit length;
    ``voxel`` and ``length`` are written, and ``middle`` too when it has rows.
    """
    nx, ny, nz = shape
    dx, dy, dz = direction[0], direction[1], direction[2]
    start = 0.0
    start, stop = _clip(origin[0], dx, nx, start, stop)
    start, stop = _clip(origin[1], dy, ny, start, stop)
    start, stop = _clip(origin[2], dz, nz, start, stop)
    if not stop > start:
        return 0

    # Measured from the entry, so that what follows does not see how far away the camera is.
    x, y, z = origin[0] + dx * start, origin[1] + dy * start, origin[2] + dz * start
    end = stop - start
    dx, dy, dz = _moving(x, dx, end), _moving(y, dy, end), _moving(z, dz, end)
    ix, step_x = _first_voxel(x, dx, nx)
    iy, step_y = _first_voxel(y, dy, ny)
    iz, step_z = _first_voxel(z, dz, nz)
    next_x = _distance_to_next(ix, step_x, x, dx, nx)
    next_y = _distance_to_next(iy, step_y, y, dy, ny)
    next_z = _distance_to_next(iz, step_z, z, dz, nz)

    count = 0
    here = 0.0
    while True:
        there = min(next_x, next_y, next_z)
        reached = min(there, end)
        if reached > here:
            if at >= 0:
                slot = at + count
                voxel[slot] = (ix * ny + iy) * nz + iz
                length[slot] = (reached - here) * weight
                if middle.shape[0] > 0:
                    half = (here + reached) / 2
                    middle[slot, 0] = x + dx * half
                    middle[slot, 1] = y + dy * half
                    middle[slot, 2] = z + dz * half
            count += 1
            here = reached
        if there >= end:
            return count
        if there == next_x:
            ix += step_x
            next_x = _distance_to_next(ix, step_x, x, dx, nx)
        elif there == next_y:
            iy += step_y
            next_y = _distance_to_next(iy, step_y, y, dy, ny)
        else:
            iz += step_z
            next_z = _distance_to_next(iz, step_z, z, dz, nz)


@compiled(parallel=True)
def _count(origins, directions, lengths, shape, counts):
    no_voxel = np.zeros(0, np.int32)
    no_length = np.zeros(0, np.float32)
    no_middle = np.zeros((0, 3), np.float64)
    for ray in numba.prange(len(origins)):
        counts[ray] = _walk(
            origins[ray], directions[ray], lengths[ray], shape, 1.0, -1,
            no_voxel, no_length, no_middle,
        )  # fmt: skip


@compiled(parallel=True)
def _fill(origins, directions, lengths, shape, weights, ptr, voxel, length, middle):
    for ray in numba.prange(len(origins)):
        _walk(
            origins[ray], directions[ray], lengths[ray], shape, weights[ray], ptr[ray],
            voxel, length, middle,
        )  # fmt: skip


def trace(
    rays: Rays, grid: VoxelGrid, *, midpoints: bool = False, dtype: DTypeLike = np.float32
) -> Segments:
    """Trace rays with the compiled walk on all cores; see `tomo.trace.trace`."""
    origins = grid.to_voxel_units(rays.origins)  # (N, 3)
    directions = rays.directions / grid.spacing  # (N, 3)
    counts = np.zeros(len(rays), np.int64)
    _count(origins, directions, rays.lengths, grid.shape, counts)
    ray_ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    n_segments = int(ray_ptr[-1])
    voxel = np.zeros(n_segments, voxel_dtype(grid))
    length = np.zeros(n_segments, dtype)
    middle = np.zeros((n_segments if midpoints else 0, 3), np.float64)
    _fill(
        origins, directions, rays.lengths, grid.shape, rays.weight, ray_ptr, voxel, length, middle
    )
    if midpoints:
        middle -= np.asarray(grid.shape) / 2
        middle *= grid.spacing
    return Segments(
        ray_ptr[rays.pixel_ptr], voxel, length, middle.astype(dtype) if midpoints else None
    )
