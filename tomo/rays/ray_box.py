"""Where rays enter and leave the grid's box, in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.rays.rays import Rays

STILL = 1e-300
"""Voxels per length below which a ray is parallel to an axis: its reciprocal may be infinite.

Every tracer has to draw the line here: a ray in an outer face is inside while it is parallel, and
outside at once where it leaves however slowly.
"""


@dataclass(frozen=True, eq=False)
class BoxCrossing:
    """The part of every ray inside the box, in voxel units measured from the lower corner.

    Positions are taken at the entry, so that nothing depends on how far away the camera is:
    ``position + direction * t`` with ``0 <= t <= length``, ``t`` in world lengths.

    Attributes
    ----------
    position : (N, 3) float64
        Where the ray enters, in voxel units.
    direction : (N, 3) float64
        Voxels per unit of world length; zero where the ray does not get from one
        floating-point position to the next: a rotation by 90 degrees leaves 6e-17, not zero.
    length : (N,) float64
        World length inside the box; zero for a ray that misses.
    """

    position: NDArray[np.float64]
    direction: NDArray[np.float64]
    length: NDArray[np.float64]

    def first_voxel(self, shape: tuple[int, int, int]) -> NDArray[np.int64]:
        """Return the indices of the voxel that each ray moves into, ``(N, 3)``.

        On a face that is the voxel ahead; along a face the one above, or the last one.
        """
        below = np.where(self.direction < 0, np.ceil(self.position) - 1, np.floor(self.position))
        return np.clip(below, 0, np.asarray(shape) - 1).astype(np.int64)

    def planes_between(self, shape: tuple[int, int, int]) -> NDArray[np.int64]:
        """Return the number of planes strictly between each ray's entry and exit: (N,).

        A ray inside the box crosses one voxel more, fewer where it passes edges or corners.
        """
        ends = np.stack([self.position, self.position + self.direction * self.length[:, None]])
        ends = np.clip(ends, 0, shape)  # rounding leaves an end on an outer face just beyond it
        low, high = ends.min(axis=0), ends.max(axis=0)
        return np.maximum(np.ceil(high) - np.floor(low) - 1, 0).sum(axis=1).astype(np.int64)


def enter_box(rays: Rays, grid: VoxelGrid) -> BoxCrossing:
    """Clip every ray to the grid's box by the slab method.

    A ray parallel to an axis is inside that axis's slab when it lies between the two outer faces
    or on one of them. Written without ``0 * inf``: a component of `STILL` never divides.
    """
    position = grid.to_voxel_units(rays.origins)  # (N, 3)
    direction = rays.directions / grid.spacing  # (N, 3)
    shape = np.asarray(grid.shape, np.float64)
    parallel = np.abs(direction) < STILL
    divisor = np.where(parallel, 1.0, direction)
    to_lower = (0.0 - position) / divisor
    to_upper = (shape - position) / divisor
    between = (position >= 0) & (position <= shape)
    near = np.where(parallel, np.where(between, -np.inf, np.inf), np.minimum(to_lower, to_upper))
    far = np.where(parallel, np.where(between, np.inf, -np.inf), np.maximum(to_lower, to_upper))
    start = np.maximum(near.max(axis=1), 0.0)
    stop = np.minimum(far.min(axis=1), rays.lengths)
    inside = stop > start
    start = np.where(inside, start, 0.0)
    length = np.where(inside, stop - start, 0.0)
    position = position + direction * start[:, None]
    still = position + direction * length[:, None] == position
    return BoxCrossing(position, np.where(still, 0.0, direction), length)
