"""Where a camera sees every voxel, interpolated from the projected corners of bricks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from rigs import CameraLike

STEP = 4
"""Voxels along each edge of a brick: more cost accuracy, fewer cost projections."""

CHECKED = 6
"""Bricks along each axis in which the interpolation error is measured."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """The corners of bricks of voxels as one camera sees them.

    Positions between are interpolated: any lens model then costs one projection a brick.
    """

    corners: NDArray[np.float64]  # (bx + 1, by + 1, bz + 1, 2) pixels; NaN out of sight
    slack: float  # bound of the interpolation error, in pixels
    pixels_a_voxel: float  # the longest edge in the grid's middle, in pixels; NaN out of sight

    @classmethod
    def of(cls, camera: CameraLike, grid: VoxelGrid) -> Self:
        """Return the lattice of one camera, see `of_all`."""
        return cls.of_all([camera], grid)[0]

    @classmethod
    def of_all(cls, cameras: Sequence[CameraLike], grid: VoxelGrid) -> list[Self]:
        """Project the corners of a grid's bricks; the last ones may reach beyond the grid.

        The interpolation error is largest in the middle of a brick. The slack is twice the
        largest error there, over bricks spread through the grid.
        """
        bricks = bricks_of(grid.shape)
        some = [np.unique(np.linspace(0, n - 1, min(n, CHECKED)).astype(int)) for n in bricks]
        corners = _points(grid, [np.arange(n + 1) * STEP for n in bricks])
        middles = _points(grid, [(index + 0.5) * STEP for index in some])
        points = np.concatenate([corners.reshape(-1, 3), middles.reshape(-1, 3)])
        around = np.ix_(*(np.add.outer(index, (0, 1)).ravel() for index in some))
        cells = [part for index in some for part in (len(index), 2)]
        count = corners[..., 0].size
        if not cameras:
            return []
        seen = _projected(cameras, points)  # (views, N, 2)
        own = seen[:, :count].reshape(-1, *corners.shape[:3], 2)
        mean = own[:, *around].reshape(len(own), *cells, 2).mean(axis=(2, 4, 6))
        off = np.abs(mean - seen[:, count:].reshape(mean.shape)).reshape(len(own), -1)
        slack = 2 * np.max(off, axis=1, initial=0.0, where=np.isfinite(off))
        return [
            cls(one, float(by), longest)
            for one, by, longest in zip(own, slack, _longest_edges(own), strict=True)
        ]


def bricks_of(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the number of bricks along each axis that hold ``shape`` voxels."""
    nx, ny, nz = (-(-n // STEP) for n in shape)
    return nx, ny, nz


def _points(grid: VoxelGrid, positions: list[NDArray]) -> NDArray[np.float64]:
    """Return points given in voxels from the grid's lower corner: (nx, ny, nz, 3)."""
    axes = [low + s * at for low, s, at in zip(grid.lower, grid.spacing, positions, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _projected(cameras: Sequence[CameraLike], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return pixel coordinates of points (N, 3), NaN where they are not seen: (views, N, 2)."""
    seen = np.full((len(cameras), len(points), 2), np.nan)
    pinholes, matrices = [], []
    for view, camera in enumerate(cameras):
        if not camera.sees_once:  # a camera with several images of a point carves nothing
            continue
        if camera.is_pinhole:
            pinholes.append(view)
            matrices.append(camera.camera_matrix @ np.column_stack([camera.R, camera.t]))
            continue
        uv, _, valid = camera.project(points)
        seen[view, valid] = uv[valid]
    if pinholes:
        _through_pinholes(np.array(pinholes), np.stack(matrices), points, seen)
    return seen


@compiled(parallel=True)
def _through_pinholes(views, matrices, points, seen):
    """Write to ``seen`` (views, N, 2) what `Camera.project`, which takes longer, finds of points.

    ``matrices`` (V, 3, 4) are those of some views, which ``views`` (V,) names.
    """
    for n in numba.prange(len(views)):
        matrix, own = matrices[n], seen[views[n]]
        for p in range(len(points)):
            x, y, z = points[p, 0], points[p, 1], points[p, 2]
            depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
            if not depth > 0:
                depth = np.nan
            for axis in range(2):
                at = matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z
                own[p, axis] = (at + matrix[axis, 3]) / depth


def _longest_edges(corners: NDArray[np.float64]) -> list[float]:
    """Return each view's longest of a voxel in the middle brick, in pixels; NaN out of sight."""
    middle = tuple(slice((n - 1) // 2, (n - 1) // 2 + 2) for n in corners.shape[1:4])
    own = corners[:, *middle]
    edges = [np.diff(own, axis=axis).reshape(len(own), -1) for axis in (1, 2, 3)]
    return (np.abs(np.concatenate(edges, axis=1)).max(axis=1) / STEP).tolist()
