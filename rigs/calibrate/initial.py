"""First values: each camera's lens by itself, then all poses along the tree of shared views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate._lens_choice import Terms, choose
from rigs.calibrate._projection import Lens
from rigs.calibrate._robust import adjust_robustly
from rigs.calibrate._target_pose import camera_poses, flat_poses, seen_well
from rigs.calibrate.bundle import Freedom, Scene, Sightings

LEAST_VIEWS = 3
_FOCAL_LENGTHS = 0.3 * 1.4 ** np.arange(17)  # image widths: 0.3 to 65
_TRIED_FRAMES = 12
_BEHIND = 1e6  # pixels: how far off a point behind the camera counts


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


@dataclass(frozen=True)
class _Image:
    """One camera's sightings in one frame, the lens taken out."""

    points: NDArray[np.float64]  # (n, 3)
    pinhole: NDArray[np.float64]  # (n, 2)
    focal: float


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
        errors = []
        for frame in tried:
            own = sightings.frame == frame
            points, pinhole = sightings.points[own], lens.pinhole(sightings.uv[own])
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


def rig_poses(
    names: tuple[str, ...], views: list[View], sightings: Sightings, frames: int
) -> tuple[Scene, int]:
    """Return cameras and targets in the axes of the camera of most shared views, and which it is.

    Each pair of cameras that saw the target at once gets its relative pose from the shared frame
    that explains the others best, whichever of the two answers of a flat target is meant. Poses
    follow the maximum spanning tree of the pairs, weighted by the points that agree.

    Parameters
    ----------
    names : tuple of str
        The cameras, for errors.
    views : list of View
    sightings : Sightings
        In order of camera, then frame.
    frames : int

    Raises
    ------
    ValueError
        Naming the cameras, if no chain of shared frames joins all.
    """
    count = len(views)
    images = _images(views, sightings)
    weight, relative = np.zeros((count, count)), {}
    for a in range(count):
        for b in range(a + 1, count):
            found = _relative_pose(views[a], views[b], a, b, images)
            if found is not None:
                R, t, weight[a, b] = found
                weight[b, a] = weight[a, b]
                relative[a, b] = R, t
                relative[b, a] = R.T, -R.T @ t
    root = int(np.argmax(weight.sum(axis=1)))
    camera_R, camera_t = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    camera_R[root], camera_t[root] = np.eye(3), 0.0
    joined = np.zeros(count, bool)
    joined[root] = True
    while not joined.all():
        border = np.where(joined[:, None] & ~joined[None, :], weight, 0.0)
        a, b = np.unravel_index(np.argmax(border), border.shape)
        if border[a, b] <= 0:
            apart = ", ".join(name for name, is_in in zip(names, joined, strict=True) if not is_in)
            rest = ", ".join(name for name, is_in in zip(names, joined, strict=True) if is_in)
            raise ValueError(
                f"cameras {apart}: found no frame in which they see the target together with "
                f"{rest}, expected shared views that join all cameras"
            )
        R, t = relative[int(a), int(b)]
        camera_R[b], camera_t[b] = R @ camera_R[a], R @ camera_t[a] + t
        joined[b] = True
    lenses = tuple(view.lens for view in views)
    empty = Scene(
        lenses, camera_R, camera_t, np.full((frames, 3, 3), np.nan), np.full((frames, 3), np.nan)
    )
    return _with_targets(empty, views, images), root


def image_rows(sightings: Sightings) -> list[tuple[int, int, slice]]:
    """Return camera, frame and place of the sightings of each image."""
    if not len(sightings):
        return []
    change = np.diff(sightings.camera).astype(bool) | np.diff(sightings.frame).astype(bool)
    bounds = np.r_[0, np.flatnonzero(change) + 1, len(sightings)].tolist()
    return [
        (int(sightings.camera[a]), int(sightings.frame[a]), slice(a, b))
        for a, b in pairwise(bounds)
    ]


def _images(views: list[View], sightings: Sightings) -> dict[tuple[int, int], _Image]:
    """Return the images by camera and frame."""
    pinhole = np.full((len(sightings), 2), np.nan)
    focal = [float(np.sqrt(np.prod(np.diag(view.lens.matrix)[:2]))) for view in views]
    for camera, view in enumerate(views):
        own = sightings.camera == camera
        pinhole[own] = view.lens.pinhole(sightings.uv[own])
    return {
        (camera, frame): _Image(sightings.points[rows], pinhole[rows], focal[camera])
        for camera, frame, rows in image_rows(sightings)
    }


def _relative_pose(
    one: View, other: View, a: int, b: int, images: dict[tuple[int, int], _Image]
) -> tuple[NDArray, NDArray, float] | None:
    """Return R, t from the axes of camera a to those of b and how many points agree."""
    shared = np.flatnonzero(np.isfinite(one.rms[:, 0]) & np.isfinite(other.rms[:, 0]))
    if not len(shared):
        return None
    some = shared[np.linspace(0, len(shared) - 1, min(len(shared), _TRIED_FRAMES)).astype(int)]
    candidates = []
    for frame in some:
        for i in range(2):
            for j in range(2):
                if np.isfinite(one.rms[frame, i]) and np.isfinite(other.rms[frame, j]):
                    R = other.R[frame, j] @ one.R[frame, i].T
                    candidates.append((R, other.t[frame, j] - R @ one.t[frame, i]))
    R = np.array([R for R, _ in candidates])  # (n, 3, 3)
    t = np.array([t for _, t in candidates])
    errors = np.stack([_errors(one, frame, R, t, images[b, frame]) for frame in some])
    best = int(np.argmin(np.log1p(errors).sum(axis=0)))
    weight = sum(
        min(len(images[a, frame].points), len(images[b, frame].points)) / (1 + (error / 2) ** 2)
        for frame, error in zip(some, errors[:, best], strict=True)
    )
    return R[best], t[best], float(weight * len(shared) / len(some))


def _errors(one: View, frame: int, R: NDArray, t: NDArray, image: _Image) -> NDArray[np.float64]:
    """Return the RMS in pixels of relative poses ``(n, ...)`` in one frame, the better answer."""
    errors = np.full((2, len(R)), _BEHIND)
    for i in range(2):
        if np.isfinite(one.rms[frame, i]):
            in_one = image.points @ one.R[frame, i].T + one.t[frame, i]
            errors[i] = _pixels(image, in_one @ R.transpose(0, 2, 1) + t[:, None])
    return errors.min(axis=0)


def _pixels(image: _Image, in_camera: NDArray) -> NDArray[np.float64]:
    """Return the RMS in pixels of ``in_camera`` ``(n, points, 3)`` against the image."""
    depth = in_camera[:, :, 2]
    before = (depth > 0).all(axis=1)
    safe = np.where(depth > 0, depth, 1.0)[:, :, None]
    squares = ((in_camera[:, :, :2] / safe - image.pinhole) ** 2).sum(axis=2)
    known = np.isfinite(squares)
    mean = np.where(known, squares, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.where(before, np.minimum(image.focal * np.sqrt(mean), _BEHIND), _BEHIND)


def _with_targets(scene: Scene, views: list[View], images: dict[tuple[int, int], _Image]) -> Scene:
    """Return the scene with each frame's pose: the camera's and answer that fit all best."""
    target_R, target_t = scene.target_R.copy(), scene.target_t.copy()
    by_frame: dict[int, list[tuple[int, _Image]]] = {}
    for (camera, frame), image in images.items():
        by_frame.setdefault(frame, []).append((camera, image))
    for frame, seen in by_frame.items():
        poses = []
        for camera, _ in seen:
            turn, shift = scene.camera_R[camera].T, scene.camera_t[camera]
            for i in range(2):
                if np.isfinite(views[camera].rms[frame, i]):
                    R = views[camera].R[frame, i]
                    poses.append((turn @ R, turn @ (views[camera].t[frame, i] - shift)))
        if not poses:
            continue
        R = np.array([R for R, _ in poses])  # (n, 3, 3)
        t = np.array([t for _, t in poses])
        loss = np.zeros(len(poses))
        for camera, image in seen:
            in_world = image.points @ R.transpose(0, 2, 1) + t[:, None]
            in_camera = in_world @ scene.camera_R[camera].T + scene.camera_t[camera]
            loss += np.log1p(_pixels(image, in_camera)) * len(image.points)
        best = int(np.argmin(loss))
        target_R[frame], target_t[frame] = R[best], t[best]
    return replace(scene, target_R=target_R, target_t=target_t)
