"""Start values from each camera's own images: its lens, and the target's pose before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.culling import adjust_robustly
from rigs.calibrate.adjust.lens_choice import LensRules, Terms, choose
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.adjust.target_pose import camera_poses, fixes_pose, flat_poses

LEAST_VIEWS = 3  # images of one camera; fewer do not determine its focal length
_FOCAL_LENGTHS = 0.3 * 1.6 ** np.arange(12)  # image widths: 0.3 to 53
_TRIED_FRAMES = 8  # with which focal lengths are compared


@dataclass(frozen=True)
class SingleCamera:
    """One camera's lens, and both answers for the target's pose of each frame in its axes.

    Parameters
    ----------
    lens : Lens
    terms : Terms
        The terms of the lens that are free.
    R, t : (frames, 2, 3, 3), (frames, 2, 3)
        The better pose first; NaN where there is none.
    rms : (frames, 2)
        Pixels; infinite where there is no pose.
    """

    lens: Lens
    terms: Terms
    R: NDArray[np.float64]
    t: NDArray[np.float64]
    rms: NDArray[np.float64]


def lens_alone(
    name: str,
    observations: ObservationArrays,
    frames: int,
    image_size: tuple[int, int],
    distortion: str,
    rules: LensRules,
) -> tuple[Lens, Terms]:
    """Return one camera's lens from its own observations.

    The focal length starts as the one of a ladder of values that leaves the least residuals in
    some frames. Lens and poses are then adjusted together, robustly.

    Parameters
    ----------
    name : str
        The camera's name, for errors.
    observations : ObservationArrays
        This camera's, as camera 0, in order of frame.
    frames : int
        Number of frames.
    image_size : (int, int)
    distortion : str
        "auto" or a name of ``TERMS``.
    rules : LensRules
        What is known of the lens.

    Raises
    ------
    ValueError
        If fewer than 3 frames show enough of the target.
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
