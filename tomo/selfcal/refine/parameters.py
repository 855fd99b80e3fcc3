"""The refined parameters of a camera: position, rotation, focal length and gain.

The eight parameters are the motion along the camera's own axes right, down and forward in length
units (0 to 2), the rotation about these axes in radians (3 to 5), the logarithm of the ratio of
focal lengths (6) and the logarithm of the gain (7). All are zero for the camera as given, and none
depends on the size to which images are downsampled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from rigs.geometry.rotation import matrix_of_vector
from rigs.scene.scene_camera import own_camera
from tomo.grid import VoxelGrid

COUNT = 8
"""Parameters of a camera."""

GEOMETRY = 7
"""Number of leading parameters that change the geometry; the gain follows."""

FOCAL, GAIN = 6, 7
"""Indices of the logarithms of focal length and gain."""


def moved(camera: CameraLike, parameters: NDArray[np.float64]) -> CameraLike:
    """Return the camera with its position, rotation and focal length changed.

    One that looks through a scene moves in it.
    """
    own = own_camera(camera)
    R = matrix_of_vector(parameters[3:6]) @ own.R
    position = own.position + own.R.T @ parameters[:3]
    matrix = np.array(own.camera_matrix)
    matrix[:2, :2] *= np.exp(parameters[FOCAL])
    return camera.with_pose(matrix, R, -R @ position)


def moved_rig(rig: Rig, parameters: NDArray[np.float64]) -> Rig:
    """Return the rig with each camera moved by its row of ``parameters`` ``(cameras, 8)``."""
    cameras = tuple(
        moved(camera, own) if own[:GEOMETRY].any() else camera
        for camera, own in zip(rig, parameters, strict=True)
    )
    return replace(rig, cameras=cameras)


def image_derivatives(
    project: Callable[[NDArray[np.float64]], NDArray],
    camera: CameraLike,
    gradient: NDArray[np.float64],
    centers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the derivatives of a camera's prediction by its geometry: ``(7, pixels)``.

    A moving camera records the same image as a fixed camera of a volume ``f`` that moves the other
    way. In camera axes the emission at ``x`` then changes by ``-v(x) . grad f``. The velocity
    ``v`` is ``-e_k`` for a motion along axis k, ``e_k x x`` for a rotation about it, and
    ``(x, y, 0)`` for the focal length. The derivative is the projection of that volume, exact for
    smooth ``f``.

    Parameters
    ----------
    project : callable
        Projects unknowns ``(n,)`` to the pixels of the camera.
    camera : CameraLike
    gradient : (n, 3)
        Gradient of the emission along the world axes at the ``centers``.
    centers : (n, 3)
        World coordinates of the voxels.
    """
    x, y, z = (centers @ camera.R.T + camera.t).T
    gx, gy, gz = (gradient @ camera.R.T).T
    fields = (
        gx,
        gy,
        gz,
        -(y * gz - z * gy),
        -(z * gx - x * gz),
        -(x * gy - y * gx),
        -(x * gx + y * gy),
    )
    return np.stack([np.asarray(project(field), np.float64) for field in fields])


def volume_gradient(volume: NDArray, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the volume's central differences, zero outside the grid: ``(voxels, 3)``."""
    padded = np.pad(np.asarray(volume, np.float64).reshape(grid.shape), 1)
    inner = slice(1, -1)
    parts = []
    for axis, spacing in enumerate(grid.spacing):
        ahead = [inner] * 3
        behind = [inner] * 3
        ahead[axis], behind[axis] = slice(2, None), slice(None, -2)
        parts.append((padded[tuple(ahead)] - padded[tuple(behind)]).ravel() / (2 * spacing))
    return np.stack(parts, axis=-1)
