"""First values of each camera by itself: its lens, and where the target stands before it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.lens_choice import Terms, choose
from rigs.calibrate.adjust.observation_arrays import Freedom, Scene, Sightings
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.adjust.robust import adjust_robustly
from rigs.calibrate.adjust.target_pose import camera_poses, flat_poses, seen_well

LEAST_VIEWS = 3
_FOCAL_LENGTHS = 0.3 * 1.6 ** np.arange(12)  # image widths: 0.3 to 53
_TRIED_FRAMES = 8


@dataclass(frozen=True)
class View:
    """One camera by itself: its lens and both target poses of each frame in its axes.

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
    sightings: Sightings,
    frames: int,
    image_size: tuple[int, int],
    distortion: str = "auto",
) -> tuple[Lens, Terms]:
    """Return one camera's lens from its own sightings.

    The focal length starts as that of a ladder with the least residuals at both poses of some
    frames; then lens and poses are adjusted together, robustly.

    Parameters
    ----------
    name : str
        Of the camera, for errors.
    sightings : Sightings
        Of this camera, as camera 0, in order of frame.
    frames : int
        How many there are in all.
    image_size : (int, int)
    distortion : str
        "auto" or a name of ``TERMS``.

    Raises
    ------
    ValueError
        If fewer than 3 frames show enough of the target.
    """
    good = np.zeros(frames, bool)
    for frame in np.unique(sightings.frame):
        good[frame] = seen_well(sightings.points[sightings.frame == frame])
    if good.sum() < LEAST_VIEWS:
        raise ValueError(
            f"camera {name}: found {int(good.sum())} images with 6 or more target points not on "
            f"a line, expected at least {LEAST_VIEWS} to find its lens"
        )
    sightings = sightings.where(good[sightings.frame])
    lens = _first_lens(sightings, image_size, "fisheye" if distortion == "fisheye" else "none")
    for _ in range(2):
        R, t, rms = camera_poses(lens, sightings, frames)
        posed = np.isfinite(rms[:, 0])
        if posed.sum() < LEAST_VIEWS:
            raise ValueError(
                f"camera {name}: found a target pose in {int(posed.sum())} images, expected at "
                f"least {LEAST_VIEWS}: is the target described rightly?"
            )
        sightings = sightings.where(posed[sightings.frame])
        scene = Scene((lens,), np.eye(3)[None], np.zeros((1, 3)), R[:, 0], t[:, 0])
        free = np.zeros(lens.size, bool)
        free[:2] = True
        solution = adjust_robustly(
            scene, sightings, Freedom((free,), np.zeros(1, bool)), tolerance=1e-3
        )
        lens = solution.scene.lenses[0]
    terms, solution = choose(solution.scene, sightings, image_size, distortion)
    return solution.scene.lenses[0], terms


def _first_lens(sightings: Sightings, image_size: tuple[int, int], model: str) -> Lens:
    """Return the lens of a ladder of focal lengths with the least residuals."""
    frames, counts = np.unique(sightings.frame, return_counts=True)
    tried = frames[np.argsort(-counts, kind="stable")]
    tried = tried[np.linspace(0, len(tried) - 1, min(len(tried), _TRIED_FRAMES)).astype(int)]
    width, height = image_size
    lenses, scores = [], []
    for focal in _FOCAL_LENGTHS * max(width, height):
        matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
        lens = Lens(matrix, "none", np.zeros(0)).with_model(model)
        errors, directions = [], lens.pinhole(sightings.uv)
        for frame in tried:
            own = sightings.frame == frame
            points, pinhole = sightings.points[own], directions[own]
            error = np.inf
            for R, t in flat_poses(points, pinhole)[:1]:
                in_camera = points @ R.T + t
                shift = in_camera[:, :2] / in_camera[:, 2:] - pinhole
                error = focal * np.sqrt(np.nanmean((shift**2).sum(axis=1)))
            errors.append(error)
        lenses.append(lens)
        scores.append(np.median(errors))
    return lenses[int(np.argmin(scores))]


def view_with(lens: Lens, terms: Terms, sightings: Sightings, frames: int) -> View:
    """Return the camera of ``lens`` with the target's poses before it."""
    return View(lens, terms, *camera_poses(lens, sightings, frames))


def check_view(name: str, one: View) -> None:
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
