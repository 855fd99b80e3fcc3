"""What projectors are compared with: a plain walk from voxel to voxel, and reading memory.

The walk is Amanatides and Woo's, "A fast voxel traversal algorithm for ray tracing" (Eurographics
1987), as it is usually written: the distance to the next plane of each axis is kept up to date by
adding the distance between two planes, the nearest one decides the step, and the voxel's number is
updated by adding its stride. It is compiled, runs one pixel after another on all cores and takes
rays that were clipped to the box before, so that a comparison is one of walks alone.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.rays.ray_box import BoxCrossing


@numba.njit(inline="always")
def _start(position, direction, count, stride):
    """Return an axis's first voxel, the way to its next plane, between planes, and the step."""
    if direction > 0:
        voxel = min(max(math.floor(position), 0), count - 1)
        return voxel, (voxel + 1 - position) / direction, 1.0 / direction, stride
    if direction < 0:
        voxel = min(max(math.ceil(position) - 1, 0), count - 1)
        return voxel, (voxel - position) / direction, -1.0 / direction, -stride
    return min(max(math.floor(position), 0), count - 1), np.inf, np.inf, 0


@numba.njit(parallel=True)
def _walk(positions, directions, lengths, shape, volume, images):
    ny, nz = shape[1], shape[2]
    for ray in numba.prange(len(images)):
        end = lengths[ray]
        if not end > 0:
            images[ray] = 0
            continue
        x, next_x, between_x, step_x = _start(
            positions[ray, 0], directions[ray, 0], shape[0], ny * nz
        )
        y, next_y, between_y, step_y = _start(positions[ray, 1], directions[ray, 1], ny, nz)
        z, next_z, between_z, step_z = _start(positions[ray, 2], directions[ray, 2], nz, 1)
        voxel = (x * ny + y) * nz + z
        last = end * (1 - 1e-9)  # a plane this close to the end is the outer face
        here, total = 0.0, 0.0
        while True:
            if next_x < next_y and next_x < next_z:
                there, step = next_x, step_x
                next_x += between_x
            elif next_y < next_z:
                there, step = next_y, step_y
                next_y += between_y
            else:
                there, step = next_z, step_z
                next_z += between_z
            if there >= last:
                break
            total += (there - here) * volume[voxel]
            here = there
            voxel += step
        images[ray] = total + (end - here) * volume[voxel]


def project(box: BoxCrossing, grid: VoxelGrid, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the line integrals ``(rays,)`` of ``volume`` ``(voxels,)`` along rays in the box."""
    images = np.zeros(len(box.length), np.float32)
    _walk(box.position, box.direction, box.length, grid.shape, volume, images)
    return images


LARGE = (64, 1_000_000)  # 256 MB: beyond every cache; many more rows than threads


@numba.njit(parallel=True, fastmath={"reassoc", "nsz", "contract"})
def _sum_rows(values, sums) -> None:
    for part in numba.prange(len(sums)):
        row, total = values[part], np.float32(0)
        for place in range(len(row)):
            total += row[place]
        sums[part] = total


def read(values: NDArray[np.float32]) -> None:
    """Read ``values``, of the shape `LARGE`, on all threads."""
    _sum_rows(values, np.zeros(len(values), np.float32))
