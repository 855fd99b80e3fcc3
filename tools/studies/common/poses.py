"""Rigs whose cameras stand and look a little elsewhere than they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig, box_points
from rigs.geometry.rotation import matrix_of_vector
from tomo import VoxelGrid


def disturbed(rig: Rig, grid: VoxelGrid, seed: int, pixels: float, but: str | None = None) -> Rig:
    """Return the rig with every camera but one moved and turned at random.

    Each of three shifts and three turns moves a camera's image by a normal random number of
    pixels with the standard deviation ``pixels``.
    """
    random = np.random.default_rng(seed)
    cameras = []
    for camera in rig:
        stays = camera.name == but
        cameras.append(
            camera if stays else displaced(camera, grid, random.normal(size=6) * pixels)
        )
    return replace(rig, cameras=tuple(cameras))


def displaced(camera: CameraLike, grid: VoxelGrid, pixels: NDArray[np.float64]) -> CameraLike:
    """Return a camera shifted along, and turned about, its axes right, down and forward.

    ``pixels`` ``(6,)`` say by how much each of the three shifts, then of the three turns, moves
    its image: that of a length at the middle of the grid, for a roll that of the grid's points.
    """
    focal = float(np.sqrt(camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]))
    depth = abs(float(camera.R[2] @ np.asarray(grid.center) + camera.t[2]))
    corners = camera.project(box_points(grid.lower, grid.upper, 2))[0]
    spread = np.square(corners - corners.mean(axis=0)).sum() / 3 / len(corners)  # over the box
    turn = pixels[3:] / (focal, focal, np.sqrt(spread))
    R = matrix_of_vector(turn) @ camera.R
    position = camera.position + camera.R.T @ (pixels[:3] * depth / focal)
    return camera.with_pose(camera.camera_matrix, R, -R @ position)
