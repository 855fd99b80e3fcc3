"""Where a camera sees every voxel, from the projections of a few points between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from rigs import Camera

STEP = 4
"""Voxels along each edge of a brick."""

CHECKED = 6
"""Bricks along each axis in which interpolation is checked."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """The corners of bricks of voxels as one camera sees them.

    What lies between is interpolated: any lens model then costs one projection a brick.

    Attributes
    ----------
    corners : (bx + 1, by + 1, bz + 1, 2) float64
        Pixel coordinates (column, row); NaN where the camera cannot see.
    slack : float
        By how many pixels an interpolated position may be off.
    pixels_a_voxel : float
        The longest edge of a voxel in the grid's middle, in pixels; NaN out of sight.
    """

    corners: NDArray[np.float64]
    slack: float
    pixels_a_voxel: float

    @classmethod
    def of(cls, camera: Camera, grid: VoxelGrid) -> Lattice:
        """Project the corners of a grid's bricks; the last ones may reach beyond the grid.

        Notes
        -----
        Interpolation is farthest off in the middle of a brick: twice the largest error there, in
        bricks spread over the grid, is the slack.
        """
        bricks = bricks_of(grid.shape)
        corners = _projected(camera, grid, [np.arange(n + 1) * STEP for n in bricks])
        some = [np.unique(np.linspace(0, n - 1, min(n, CHECKED)).astype(int)) for n in bricks]
        middles = _projected(camera, grid, [(index + 0.5) * STEP for index in some])
        mean = sum(
            corners[np.ix_(some[0] + i, some[1] + j, some[2] + k)]
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ) / 8  # fmt: skip
        off = np.abs(mean - middles)
        slack = 2 * float(off[np.isfinite(off)].max(initial=0.0))
        middle = tuple(slice(n // 2, n // 2 + 2) for n in bricks)  # one brick's corners
        edges = np.stack([np.diff(corners[middle], axis=a).reshape(-1, 2) for a in range(3)])
        size = np.abs(edges).max() / STEP  # NaN where the brick is not seen
        return cls(corners, slack, float(size))


def bricks_of(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the number of bricks along each axis that hold ``shape`` voxels."""
    return tuple(-(-n // STEP) for n in shape)


def _projected(camera: Camera, grid: VoxelGrid, places: list[NDArray]) -> NDArray[np.float64]:
    """Return the pixel coordinates of points given in voxels from the grid's lower corner."""
    axes = [low + s * at for low, s, at in zip(grid.lower, grid.spacing, places, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    if not camera.sees_once:  # one place of several would pass for the only one
        return np.full((*points.shape[:3], 2), np.nan)
    uv, _, valid = camera.project(points.reshape(-1, 3))
    uv[~valid] = np.nan
    return uv.reshape((*points.shape[:3], 2))
