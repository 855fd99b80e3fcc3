"""The target's pose before one camera: both answers, as a flat target often has two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.adjust.projection import Lens

LEAST_POINTS = 6  # of an image; fewer leave the pose to the noise
_LEAST_SPREAD = 0.02  # of the points across their longest direction; less is nearly a line


def fixes_pose(points: NDArray[np.float64]) -> bool:
    """Return whether ``points`` ``(n, 3)`` fix the target's pose: enough, and not on a line."""
    if len(points) < LEAST_POINTS:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _LEAST_SPREAD * spread[0])


def flat_poses(
    points: NDArray[np.float64], pinhole: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return up to two poses of a flat target, the better first.

    Collins and Bartoli, "Infinitesimal plane-based pose estimation" (2014), as in OpenCV.

    Parameters
    ----------
    points : (n, 3) float64
        On the target, z = 0.
    pinhole : (n, 2) float64
        ``x / z, y / z``; rows that are NaN are left out.
    """
    import cv2

    known = np.isfinite(pinhole).all(axis=1)
    if not fixes_pose(points[known]):
        return []
    # The method needs points relative to their middle
    middle = points[known].mean(axis=0)
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            points[known] - middle, pinhole[known], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    found = []
    for turn, shift in zip(turns, shifts, strict=True):
        R = np.asarray(cv2.Rodrigues(turn)[0], np.float64)
        t = shift.ravel() - R @ middle
        in_camera = points[known] @ R.T + t
        if np.isfinite(in_camera).all() and (in_camera[:, 2] > 0).all():
            error = in_camera[:, :2] / in_camera[:, 2:] - pinhole[known]
            found.append((float((error**2).mean()), R, t))
    return [(R, t) for _, R, t in sorted(found, key=lambda answer: answer[0])]


def camera_poses(
    lens: Lens, observations: ObservationArrays, frames: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return both target poses in one camera's axes, refined to least residuals.

    Parameters
    ----------
    lens : Lens
    observations : ObservationArrays
        One camera's, in order of frame.
    frames : int
        Number of frames.

    Returns
    -------
    R, t : (frames, 2, 3, 3), (frames, 2, 3)
        The better first; NaN where there is none.
    rms : (frames, 2)
        Root mean square of the residuals' lengths, pixels; infinite where there is no pose.
    """
    R, t = np.full((2 * frames, 3, 3), np.nan), np.full((2 * frames, 3), np.nan)
    pinhole = lens.pinhole(observations.uv)
    for frame in np.unique(observations.frame):
        own = observations.frame == frame
        for answer, pose in enumerate(flat_poses(observations.points[own], pinhole[own])[:2]):
            R[frame + answer * frames], t[frame + answer * frames] = pose
    both = [np.arange(len(observations))] * 2
    twice = ObservationArrays(
        np.zeros(2 * len(observations), np.int64),
        np.concatenate([observations.frame, observations.frame + frames]),
        *(
            np.concatenate([array[i] for i in both])
            for array in (observations.points, observations.uv)
        ),
    )
    scene = Scene((lens,), np.eye(3)[None], np.zeros((1, 3)), R, t)
    start = np.isfinite(predicted(scene, twice)).all(axis=1)
    whole = np.bincount(twice.frame, ~start, 2 * frames) == 0  # all points before the camera
    twice = twice.where(whole[twice.frame])
    rms = np.full(2 * frames, np.inf)
    if len(twice):
        fixed = Freedom((np.zeros(lens.size, bool),), np.zeros(1, bool))
        solution = adjust(scene, twice, fixed, iterations=8, tolerance=1e-4)
        scene = solution.scene
        squares = (solution.residuals**2).sum(axis=1)
        counts = np.bincount(twice.frame, minlength=2 * frames)
        sums = np.bincount(twice.frame, squares, 2 * frames)
        rms[counts > 0] = np.sqrt(sums[counts > 0] / counts[counts > 0])
    posed = np.isfinite(rms)
    turns = np.where(posed[:, None, None], scene.target_R, np.nan).reshape(2, frames, 3, 3)
    shifts = np.where(posed[:, None], scene.target_t, np.nan).reshape(2, frames, 3)
    both_rms = rms.reshape(2, frames)
    order = np.argsort(both_rms, axis=0, kind="stable")
    rows = np.arange(frames)
    pick = [(order[i], rows) for i in range(2)]
    return (
        np.stack([turns[i] for i in pick], axis=1),
        np.stack([shifts[i] for i in pick], axis=1),
        np.stack([both_rms[i] for i in pick], axis=1),
    )
