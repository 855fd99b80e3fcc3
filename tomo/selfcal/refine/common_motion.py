"""What only moves, turns or enlarges the whole scene is no change of the cameras.

It is not harmless either: it carries the flame to another place between the grid's voxels, and
half a voxel changes the squared error of held-out rays by a tenth. Cameras that drift together
would be taken for better ones, or for worse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, box_points, image_motion
from tomo.grid import VoxelGrid
from tomo.selfcal.refine.parameters import COUNT, FOCAL, GAIN, moved_rig

POINTS = 5
"""Along each side of the volume, where its images are looked at."""

STEP = 1e-4
"""Share of a voxel by which points are moved to see how their images move."""


def without_common_motion(
    rig: Rig, grid: VoxelGrid, parameters: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return parameters less what only moves, turns or enlarges the volume, or brightens it.

    Images say nothing of a motion that all cameras share, of a scale of the whole scene about the
    grid's middle, or of a common gain, and next to nothing of a common change of focal lengths,
    which is one of the scene's size but for perspective. Of all parameters that say the same,
    those are taken that depart least from the cameras as given, in units of ``lengths``
    ``(cameras, 8)``, and then all cameras are shifted so that the volume's points stay where they
    were: turned a little aside together, cameras shift them as well, and where all cameras come
    nearer, each by its own, least departures leave a shift.
    """
    basis = _common_motions(rig, grid) / lengths  # (modes, cameras, 8)
    basis = basis.reshape(len(basis), -1)
    basis /= np.linalg.norm(basis, axis=1, keepdims=True)
    weighed = (parameters / lengths).ravel()
    shares = np.linalg.lstsq(basis.T, weighed, rcond=1e-9)[0]
    found = (weighed - shares @ basis).reshape(parameters.shape) * lengths
    shift = _shift_of_points(rig, moved_rig(rig, found), grid)
    found[:, :3] += np.array([camera.R @ shift for camera in rig])
    return found


def _common_motions(rig: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the parameters of what all cameras may have in common: ``(9, cameras, 8)``.

    Shifts and turns, a scale of the scene, focal lengths, gains.
    """
    middle, modes = np.asarray(grid.center), []
    for axis in np.eye(3):
        modes.append([np.r_[camera.R @ axis, np.zeros(5)] for camera in rig])
        modes.append(
            [
                np.r_[
                    camera.R @ np.cross(axis, camera.position - middle),
                    -camera.R @ axis,
                    np.zeros(2),
                ]
                for camera in rig
            ]
        )
    modes.append([np.r_[c.R @ (c.position - middle), np.zeros(5)] for c in rig])
    modes += [[np.eye(COUNT)[which]] * len(rig) for which in (FOCAL, GAIN)]
    return np.array(modes)


def _shift_of_points(rig: Rig, other: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the shift of the volume's points in the first rig that most nearly shows the second.

    ``argmin_s sum |u'(x) - u(x + s)|²`` over cameras and points, to first order: ``(3,)``.
    """
    points = box_points(grid.lower, grid.upper, POINTS)
    step = STEP * min(grid.spacing)
    products, sums = np.zeros((3, 3)), np.zeros(3)
    for camera, changed in zip(rig, other, strict=True):
        here, _, valid = camera.project(points)
        there, _, still = changed.project(points)
        slopes = [image_motion(camera, points, move) / step for move in step * np.eye(3)]
        slopes = np.stack(slopes, axis=-1)[valid & still].reshape(-1, 3)
        products += slopes.T @ slopes
        sums += slopes.T @ (there - here)[valid & still].ravel()
    return np.linalg.pinv(products, rcond=1e-9, hermitian=True) @ sums
