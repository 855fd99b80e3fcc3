"""Where the target stands before one camera: both answers, as a flat target often has two."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.observation_arrays import Freedom, Scene, Sightings, predicted
from rigs.calibrate.adjust.projection import Lens

LEAST_POINTS = 6
_LEAST_SPREAD = 0.02  # of the points across their longest direction, relative


def seen_well(points: NDArray[np.float64]) -> bool:
    """Say whether ``points`` ``(n, 3)`` on the target fix its pose: enough and not on a line."""
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
    if not seen_well(points[known]):
        return []
    # The method wants points about their middle
    middle = points[known].mean(axis=0)
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            points[known] - middle, pinhole[known], np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
    except cv2.error:
        return []
    found = []
    for turn, shift in zip(turns, shifts, strict=True):
        R = cv2.Rodrigues(turn)[0]
        t = shift.ravel() - R @ middle
        in_camera = points[known] @ R.T + t
        if np.isfinite(in_camera).all() and (in_camera[:, 2] > 0).all():
            error = in_camera[:, :2] / in_camera[:, 2:] - pinhole[known]
            found.append((float((error**2).mean()), R, t))
    return [(R, t) for _, R, t in sorted(found, key=lambda answer: answer[0])]


def camera_poses(
    lens: Lens, sightings: Sightings, frames: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return both target poses in one camera's axes, refined to least residuals.

    Parameters
    ----------
    lens : Lens
    sightings : Sightings
        Of one camera, in order of frame.
    frames : int
        How many there are in all.

    Returns
    -------
    R, t : (frames, 2, 3, 3), (frames, 2, 3)
        The better first; NaN where there is none.
    rms : (frames, 2)
        Root mean square of the residuals' lengths, pixels; infinite where there is no pose.
    """
    R, t = np.full((2 * frames, 3, 3), np.nan), np.full((2 * frames, 3), np.nan)
    pinhole = lens.pinhole(sightings.uv)
    for frame in np.unique(sightings.frame):
        own = sightings.frame == frame
        for place, pose in enumerate(flat_poses(sightings.points[own], pinhole[own])[:2]):
            R[frame + place * frames], t[frame + place * frames] = pose
    both = [np.arange(len(sightings))] * 2
    twice = Sightings(
        np.zeros(2 * len(sightings), np.int64),
        np.concatenate([sightings.frame, sightings.frame + frames]),
        *(np.concatenate([array[i] for i in both]) for array in (sightings.points, sightings.uv)),
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
    R = np.where(posed[:, None, None], scene.target_R, np.nan).reshape(2, frames, 3, 3)
    t = np.where(posed[:, None], scene.target_t, np.nan).reshape(2, frames, 3)
    rms = rms.reshape(2, frames)
    order = np.argsort(rms, axis=0, kind="stable")
    rows = np.arange(frames)
    pick = [(order[i], rows) for i in range(2)]
    return (
        np.stack([R[i] for i in pick], axis=1),
        np.stack([t[i] for i in pick], axis=1),
        np.stack([rms[i] for i in pick], axis=1),
    )
