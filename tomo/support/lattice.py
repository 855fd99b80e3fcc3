"""Where a camera sees every voxel, from the projections of a few points between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

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
    def of(cls, camera: Camera, grid: VoxelGrid) -> Self:
        """Project the corners of a grid's bricks; the last ones may reach beyond the grid.

        Notes
        -----
        Interpolation is farthest off in the middle of a brick: twice the largest error there, in
        bricks spread over the grid, is the slack.
        """
        return cls.of_all([camera], grid)[0]

    @classmethod
    def of_all(cls, cameras: Sequence[Camera], grid: VoxelGrid) -> list[Self]:
        """Return the lattice of each camera, see `of`."""
        bricks = bricks_of(grid.shape)
        some = [np.unique(np.linspace(0, n - 1, min(n, CHECKED)).astype(int)) for n in bricks]
        corners = _points(grid, [np.arange(n + 1) * STEP for n in bricks])
        middles = _points(grid, [(index + 0.5) * STEP for index in some])
        points = np.concatenate([corners.reshape(-1, 3), middles.reshape(-1, 3)])
        around = np.ix_(*(np.add.outer(index, (0, 1)).ravel() for index in some))
        cells = [part for index in some for part in (len(index), 2)]
        count = corners[..., 0].size
        found = []
        for camera in cameras:
            seen = _projected(camera, points)
            own = seen[:count].reshape(*corners.shape[:3], 2)
            mean = own[around].reshape(*cells, 2).mean(axis=(1, 3, 5))
            off = np.abs(mean - seen[count:].reshape(mean.shape))
            slack = 2 * float(off[np.isfinite(off)].max(initial=0.0))
            found.append(cls(own, slack, _longest_edge(own)))
        return found


def bricks_of(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the number of bricks along each axis that hold ``shape`` voxels."""
    return tuple(-(-n // STEP) for n in shape)


def _points(grid: VoxelGrid, places: list[NDArray]) -> NDArray[np.float64]:
    """Return points given in voxels from the grid's lower corner: (nx, ny, nz, 3)."""
    axes = [low + s * at for low, s, at in zip(grid.lower, grid.spacing, places, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _projected(camera: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pixel coordinates of points (N, 3), NaN where they cannot be seen: (N, 2)."""
    if not camera.sees_once:  # one place of several would pass for the only one
        return np.full((len(points), 2), np.nan)
    uv, _, valid = camera.project(points)
    uv[~valid] = np.nan
    return uv


def _longest_edge(corners: NDArray[np.float64]) -> float:
    """Return that of a voxel in the middle brick, in pixels; NaN where it is not seen."""
    middle = tuple(slice((n - 1) // 2, (n - 1) // 2 + 2) for n in corners.shape[:3])
    edges = np.stack([np.diff(corners[middle], axis=a).reshape(-1, 2) for a in range(3)])
    return float(np.abs(edges).max() / STEP)
