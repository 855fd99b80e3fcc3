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

RIGID = 7
"""Leading common motions that change no image: shifts, turns and the scale."""

REWEIGHTED = 20
"""Times that cameras are weighed anew. Fewer leave a camera that is far off some weight; more
change nothing."""

SMALL = 0.1
"""Departure, in standard deviations of the prior or in pixels, below which cameras weigh alike.
Smaller, one camera may hold all others; larger, cameras that are far off pull the scene along."""

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
    return _nearest(rig, grid, parameters, lengths, _common_motions(rig, grid), rounds=1)


def where_most_see_it(
    rig: Rig, grid: VoxelGrid, parameters: NDArray[np.float64], lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Move the whole scene, and all cameras with it, to where most of the given cameras see it.

    Arguments as of `without_common_motion`, which shares the error of one camera out: the scene
    follows it by its fraction, and cameras that were right move too. Here ``sum_v |p_v|`` is
    least, not ``sum_v |p_v|²``. Prior and steps are of squares: this comes after the last of them.
    """
    motions = _common_motions(rig, grid)[:RIGID]
    return _nearest(rig, grid, parameters, lengths, motions, rounds=REWEIGHTED)


def _nearest(
    rig: Rig,
    grid: VoxelGrid,
    parameters: NDArray[np.float64],
    lengths: NDArray[np.float64],
    motions: NDArray[np.float64],
    rounds: int,
) -> NDArray[np.float64]:
    """Return the parameters, less common ``motions``, that are nearest to the given cameras.

    Cameras weigh alike in the first of the ``rounds``, and by their distance in the others.
    """
    basis = motions / lengths  # (modes, cameras, 8)
    basis /= np.linalg.norm(basis, axis=(1, 2), keepdims=True)
    scaled, weights = parameters / lengths, np.ones(len(rig))
    for _ in range(rounds):
        roots = np.sqrt(weights)[:, None]
        left, right = (basis * roots).reshape(len(basis), -1), (scaled * roots).ravel()
        coefficients = np.linalg.lstsq(left.T, right, rcond=1e-9)[0]
        departures = scaled - np.tensordot(coefficients, basis, 1)
        weights = _weights(np.linalg.norm(departures, axis=1))
    found = departures * lengths
    shift = _shift_of_points(rig, moved_rig(rig, found), grid, rounds)
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


def _shift_of_points(rig: Rig, other: Rig, grid: VoxelGrid, rounds: int) -> NDArray[np.float64]:
    """Return the shift of the volume ``(3,)`` that best explains the images of the second rig.

    It is ``argmin_s sum_v |u_v'(x) - u_v(x + s)|²``, to first order, over the points that each
    camera sees; of the root mean squares in place of the squares after many ``rounds``.
    """
    points = box_points(grid.lower, grid.upper, POINTS)
    step = STEP * min(grid.spacing)
    slopes, moves = [], []
    for camera, changed in zip(rig, other, strict=True):
        projected, _, valid = camera.project(points)
        moved, _, still = changed.project(points)
        seen = valid & still
        own = [image_motion(camera, points, move) / step for move in step * np.eye(3)]
        size = np.sqrt(max(np.count_nonzero(seen), 1))  # for a mean over the points
        slopes.append(np.stack(own, axis=-1)[seen].reshape(-1, 3) / size)
        moves.append((moved - projected)[seen].ravel() / size)
    shift, weights = np.zeros(3), np.ones(len(rig))
    for _ in range(rounds):
        both = list(zip(weights, slopes, moves, strict=True))
        products = sum(weight * own.T @ own for weight, own, _ in both)
        sums = sum(weight * own.T @ move for weight, own, move in both)
        shift = np.linalg.pinv(products, rcond=1e-9, hermitian=True) @ sums
        weights = _weights(np.array([np.linalg.norm(m - s @ shift) for _, s, m in both]))
    return shift


def _weights(departures: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights that make squares of the cameras' departures sums of their sizes."""
    return 1 / np.hypot(departures, SMALL)
