"""Start values from each camera's own images: its lens, and the target's pose before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.culling import LEAST_POINTS, adjust_robustly
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.lens_choice import LensRules, Terms, choose
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.adjust.projection import Lens

_LEAST_SPREAD = 0.02  # of the points across their longest direction; less is nearly a line
LEAST_VIEWS = 3  # images of one camera; fewer do not determine its focal length
_FOCAL_LENGTHS = 0.3 * 1.6 ** np.arange(12)  # image widths: 0.3 to 53
_TRIED_FRAMES = 8  # with which focal lengths are compared


@dataclass(frozen=True)
class SingleCamera:
    """One camera's lens, and both answers for the target's pose of each frame in its axes."""

    lens: Lens
    terms: Terms  # those of the lens that are free
    R: NDArray[np.float64]  # (frames, 2, 3, 3), the better first; NaN without
    t: NDArray[np.float64]  # (frames, 2, 3)
    rms: NDArray[np.float64]  # (frames, 2) pixels; infinite without a pose


def lens_alone(
    name: str,
    observations: ObservationArrays,
    frames: int,
    image_size: tuple[int, int],
    distortion: str,
    rules: LensRules,
) -> tuple[Lens, Terms]:
    """Return one camera's lens from its own observations, which are those of camera 0.

    The focal length starts as the one of a ladder of values that leaves the least residuals.
    """
    good = np.zeros(frames, bool)
    for frame in np.unique(observations.frame):
        good[frame] = fixes_pose(observations.points[observations.frame == frame])
    if good.sum() < LEAST_VIEWS:
        raise ValueError(
            f"camera {name}: found {int(good.sum())} images with 6 or more target points not on "
            f"a line, expected at least {LEAST_VIEWS} to find its lens"
        )
    observations = observations.where(good[observations.frame])
    lens = _first_lens(observations, image_size, "fisheye" if distortion == "fisheye" else "none")
    for _ in range(2):
        R, t, rms = camera_poses(lens, observations, frames)
        posed = np.isfinite(rms[:, 0])
        if posed.sum() < LEAST_VIEWS:
            raise ValueError(
                f"camera {name}: found a target pose in {int(posed.sum())} images, expected at "
                f"least {LEAST_VIEWS}: is the target described correctly?"
            )
        observations = observations.where(posed[observations.frame])
        scene = Scene((lens,), np.eye(3)[None], np.zeros((1, 3)), R[:, 0], t[:, 0])
        free = np.zeros(lens.size, bool)
        free[:2] = True
        solution = adjust_robustly(scene, observations, rules.one_lens(free), tolerance=1e-3)
        lens = solution.scene.lenses[0]
    terms, solution = choose(solution.scene, observations, image_size, distortion, rules)
    return solution.scene.lenses[0], terms


def _first_lens(observations: ObservationArrays, image_size: tuple[int, int], model: str) -> Lens:
    """Return the lens whose focal length, among those of a ladder, leaves the least residuals."""
    frames, counts = np.unique(observations.frame, return_counts=True)
    tried = frames[np.argsort(-counts, kind="stable")]
    tried = tried[np.linspace(0, len(tried) - 1, min(len(tried), _TRIED_FRAMES)).astype(int)]
    width, height = image_size
    lenses, scores = [], []
    for focal in _FOCAL_LENGTHS * max(width, height):
        matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        lens = Lens(matrix, "none", np.zeros(0)).with_model(model)
        errors, directions = [], lens.pinhole(observations.uv)
        for frame in tried:
            own = observations.frame == frame
            points, pinhole = observations.points[own], directions[own]
            error = np.inf
            for R, t in flat_poses(points, pinhole)[:1]:
                in_camera = points @ R.T + t
                shift = in_camera[:, :2] / in_camera[:, 2:] - pinhole
                error = focal * np.sqrt(np.nanmean((shift**2).sum(axis=1)))
            errors.append(error)
        lenses.append(lens)
        scores.append(np.median(errors))
    return lenses[int(np.argmin(scores))]


def fixes_pose(points: NDArray[np.float64]) -> bool:
    """Return whether ``points`` ``(n, 3)`` fix the target's pose: enough, and not on a line."""
    if len(points) < LEAST_POINTS:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] > _LEAST_SPREAD * spread[0])


def flat_poses(
    points: NDArray[np.float64], pinhole: NDArray[np.float64]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return up to two poses of a flat target ``(n, 3)``, z = 0, the better first.

    ``pinhole`` ``(n, 2)`` are ``x / z, y / z``, NaN where unknown. Collins and Bartoli,
    "Infinitesimal plane-based pose estimation" (2014), as in OpenCV.
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
    """Return both target poses in one camera's axes, refined, and their RMS residuals in pixels.

    R ``(frames, 2, 3, 3)``, t ``(frames, 2, 3)``, the better first; NaN, RMS infinite, without.
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


def single_camera(
    lens: Lens, terms: Terms, observations: ObservationArrays, frames: int
) -> SingleCamera:
    """Return the camera of ``lens`` with the target's poses before it."""
    return SingleCamera(lens, terms, *camera_poses(lens, observations, frames))


def check_target_poses(name: str, one: SingleCamera) -> None:
    """Raise if the camera has no pose of the target, or sees it from behind: mirrored."""
    R, t = one.R[:, 0], one.t[:, 0]
    posed = np.isfinite(one.rms[:, 0])
    if not posed.any():
        raise ValueError(
            f"camera {name}: found no image with 6 or more target points not on a line, expected "
            "some to find its pose"
        )
    behind = int((np.einsum("fi,fi->f", R[posed, :, 2], t[posed]) < 0).sum())
    if 2 * behind > posed.sum():
        raise ValueError(
            f"camera {name}: sees the target from behind in {behind} of {int(posed.sum())} images,"
            " expected z into it: are the images, or the target's points, mirrored?"
        )
