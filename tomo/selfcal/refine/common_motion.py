"""Removal of motions common to all cameras, which only move, turn or scale the whole scene.

Images cannot show a common motion, but it is not harmless: it moves the flame relative to the
voxel centres, and half a voxel changes the squared error of held-out rays by a tenth. Cameras that
drift together would appear better, or worse, than they are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, box_points, image_motion
from tomo.grid import VoxelGrid
from tomo.selfcal.refine.parameters import COUNT, FOCAL, GAIN, moved_rig

POINTS = 5
"""Points along each side of the volume at which motions of its image are compared. Fewer miss how
motions vary over the volume; more take longer."""

STEP = 1e-4
"""Step of the finite differences, as a fraction of a voxel. Larger, curvature enters; smaller,
rounding does."""


def without_common_motion(
    rig: Rig, grid: VoxelGrid, parameters: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Subtract from the parameters the motions, scales and gains common to all cameras.

    Parameters
    ----------
    rig : Rig
        The cameras as given.
    grid : VoxelGrid
    parameters : (cameras, 8) float64
        See `tomo.selfcal.refine.parameters`.
    lengths : (cameras, 8) float64
        Standard deviations of the priors, the units in which departures are compared.

    Returns
    -------
    parameters : (cameras, 8) float64

    Notes
    -----
    Images do not determine a common motion of the cameras, a scale of the whole scene about the
    grid's centre, or a common gain. They hardly determine a common change of focal lengths, which
    scales the scene except for perspective. Among all equivalent parameters those nearest to the
    given cameras are taken. All cameras are then shifted so that the volume's points stay where
    they were, because the nearest parameters may still shift the volume, for example where every
    camera moves nearer by an amount of its own.
    """
    basis = _common_motions(rig, grid) / lengths  # (modes, cameras, 8)
    basis = basis.reshape(len(basis), -1)
    basis /= np.linalg.norm(basis, axis=1, keepdims=True)
    scaled = (parameters / lengths).ravel()
    coefficients = np.linalg.lstsq(basis.T, scaled, rcond=1e-9)[0]
    found = (scaled - coefficients @ basis).reshape(parameters.shape) * lengths
    shift = _shift_of_points(rig, moved_rig(rig, found), grid)
    found[:, :3] += np.array([camera.R @ shift for camera in rig])
    return found


def _common_motions(rig: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the common modes: 3 shifts, 3 turns, scale, focal length, gain: (9, cameras, 8)."""
    center, modes = np.asarray(grid.center), []
    for axis in np.eye(3):
        modes.append([np.r_[camera.R @ axis, np.zeros(5)] for camera in rig])
        modes.append(
            [
                np.r_[
                    camera.R @ np.cross(axis, camera.position - center),
                    -camera.R @ axis,
                    np.zeros(2),
                ]
                for camera in rig
            ]
        )
    modes.append([np.r_[c.R @ (c.position - center), np.zeros(5)] for c in rig])
    modes += [[np.eye(COUNT)[which]] * len(rig) for which in (FOCAL, GAIN)]
    return np.array(modes)


def _shift_of_points(rig: Rig, other: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the shift of the volume ``(3,)`` that best explains the images of the second rig.

    It is ``argmin_s sum |u'(x) - u(x + s)|²`` over cameras and points, to first order.
    """
    points = box_points(grid.lower, grid.upper, POINTS)
    step = STEP * min(grid.spacing)
    products, sums = np.zeros((3, 3)), np.zeros(3)
    for camera, changed in zip(rig, other, strict=True):
        projected, _, valid = camera.project(points)
        moved, _, still = changed.project(points)
        slopes = [image_motion(camera, points, move) / step for move in step * np.eye(3)]
        slopes = np.stack(slopes, axis=-1)[valid & still].reshape(-1, 3)
        products += slopes.T @ slopes
        sums += slopes.T @ (moved - projected)[valid & still].ravel()
    return np.linalg.pinv(products, rcond=1e-9, hermitian=True) @ sums
