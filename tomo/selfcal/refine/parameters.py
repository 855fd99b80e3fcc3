"""What of a camera is refined: position, turn, focal length, and the gain of its images.

A camera's eight parameters are its motion in length units along its own axes right, down and
forward (0 to 2), its turn about these axes in radians (3 to 5), the logarithms of its focal
length's change (6) and of its gain (7). All are zero for the camera as it was given, and none
depends on how far the images are shrunk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Rig
from rigs.geometry.rotation import matrix_of_vector
from tomo.grid import VoxelGrid

COUNT = 8
PLACE = 7
FOCAL, GAIN = 6, 7


def moved(camera: Camera, parameters: NDArray[np.float64]) -> Camera:
    """Return the camera with its position, turn and focal length changed."""
    R = matrix_of_vector(parameters[3:6]) @ camera.R
    position = camera.position + camera.R.T @ parameters[:3]
    matrix = np.array(camera.camera_matrix)
    matrix[:2, :2] *= np.exp(parameters[FOCAL])
    return replace(camera, camera_matrix=matrix, R=R, t=-R @ position)


def moved_rig(rig: Rig, parameters: NDArray[np.float64]) -> Rig:
    """Return the rig with every camera moved by its row of ``(cameras, 8)``; zeros move none."""
    cameras = tuple(
        moved(camera, own) if own[:PLACE].any() else camera
        for camera, own in zip(rig, parameters, strict=True)
    )
    return replace(rig, cameras=cameras)


def image_derivatives(
    project: Callable[[NDArray[np.float64]], NDArray],
    camera: Camera,
    gradient: NDArray[np.float64],
    centers: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how a camera's prediction changes with its place: ``(7, pixels)``.

    A camera that moves sees what it would see, unmoved, of a volume ``f`` that moves the other
    way: in camera axes the emission at ``x`` changes by ``-v(x) . grad f``, where ``v`` is how
    the parameter moves the points as the camera sees them: ``-e_k`` for its motion along axis k,
    ``e_k x x`` for its turn about it, ``(x, y, 0)`` for its focal length. The derivative is the
    projection of that volume, exact for smooth ``f``.

    Parameters
    ----------
    project : callable
        From unknowns ``(n,)`` to the pixels of the camera.
    camera : Camera
    gradient : (n, 3)
        Of the emission along the world's axes, at ``centers`` ``(n, 3)``.
    centers : (n, 3)
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
    """Return central differences, zero emission around the grid: ``(voxels, 3)``."""
    padded = np.pad(np.asarray(volume, np.float64).reshape(grid.shape), 1)
    inner = slice(1, -1)
    parts = []
    for axis, spacing in enumerate(grid.spacing):
        ahead = [inner] * 3
        behind = [inner] * 3
        ahead[axis], behind[axis] = slice(2, None), slice(None, -2)
        parts.append((padded[tuple(ahead)] - padded[tuple(behind)]).ravel() / (2 * spacing))
    return np.stack(parts, axis=-1)
