"""First poses of all cameras in one world, along the tree of shared views."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.film import LEAST_PICTURES, Film
from rigs.calibrate.adjust.initial import SingleCamera
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, image_rows

_TRIED_FRAMES = 12  # shared by two cameras, whose poses are compared
_BEHIND = 1e6  # pixels: residual of a point behind the camera, larger than any other
_NOT_IN_STEP = 2.0  # pixels of median residual, above which other delays are tried in a film
_IN_STEP = 0.5  # of that residual must be left at most, or the delay is not believed
_LONGEST_DELAY = 250  # pictures
_FAR_OFF = 40.0  # pixels of median residual; beyond it two cameras did not see one scene


@dataclass(frozen=True)
class _Image:
    """One camera's observations in one frame, the lens taken out."""

    points: NDArray[np.float64]  # (n, 3)
    pinhole: NDArray[np.float64]  # (n, 2)
    focal: float


def rig_poses(
    names: tuple[str, ...],
    views: list[SingleCamera],
    observations: ObservationArrays,
    frames: int,
    film: Film | None = None,
) -> tuple[Scene, int, NDArray[np.float64]]:
    """Return the poses of cameras and targets, which camera holds the axes, and offsets in time.

    The axes are those of the camera with most shared views. Each pair of cameras gets its relative
    pose from the shared frame that explains the others best, by both answers of the flat target.
    Poses follow the maximum spanning tree of the pairs, weighted by the points that agree. In a
    film a camera that does not agree is tried some pictures earlier and later; the offsets
    ``(cameras,)`` say how many pictures later its images were taken. A ValueError names cameras
    that no chain of shared frames joins, or one that is not synchronised.
    """
    count = len(views)
    images = _images(views, observations)
    weight, residual, relative = np.zeros((count, count)), np.zeros((count, count)), {}
    for a in range(count):
        for b in range(a + 1, count):
            found = _relative_pose(views[a], views[b], a, b, images)
            if found is not None:
                R, t, weight[a, b], residual[a, b] = found
                weight[b, a], residual[b, a] = weight[a, b], residual[a, b]
                relative[a, b] = R, t
                relative[b, a] = R.T, -R.T @ t
    root = int(np.argmax(weight.sum(axis=1)))
    camera_R, camera_t = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    camera_R[root], camera_t[root] = np.eye(3), 0.0
    joined = np.zeros(count, bool)
    joined[root] = True
    offset = np.zeros(count)
    while not joined.all():
        border = np.where(joined[:, None] & ~joined[None, :], weight, 0.0)
        a, b = (int(place) for place in np.unravel_index(np.argmax(border), border.shape))
        if border[a, b] <= 0:
            apart, rest = (", ".join(compress(names, some)) for some in (~joined, joined))
            raise ValueError(
                f"cameras {apart}: found no frame in which they see the target together with "
                f"{rest}, expected shared views that join all cameras"
            )
        if film is not None and residual[a, b] > _NOT_IN_STEP:
            delay, found = _delayed(views, int(a), int(b), images, film)
            if found[3] < _IN_STEP * residual[a, b]:
                relative[int(a), int(b)], residual[a, b] = found[:2], found[3]
                offset[b] = delay
        offset[b] += offset[a]
        if residual[a, b] > _FAR_OFF:
            raise ValueError(
                f"camera {names[b]}: sees the target {residual[a, b]:.0f} px from where camera "
                f"{names[a]} does in most of their shared frames, expected images of the same "
                "moments from cameras at rest: one is not synchronised or was moved"
            )
        R, t = relative[int(a), int(b)]
        camera_R[b], camera_t[b] = R @ camera_R[a], R @ camera_t[a] + t
        joined[b] = True
    lenses = tuple(view.lens for view in views)
    empty = Scene(
        lenses, camera_R, camera_t, np.full((frames, 3, 3), np.nan), np.full((frames, 3), np.nan)
    )
    if film is not None and offset.any():
        views, images = _in_step(views, images, film, offset)
    return _with_targets(empty, views, images), root, offset


def _delayed(
    views: list[SingleCamera], a: int, b: int, images: dict, film: Film
) -> tuple[float, tuple]:
    """Return by how much camera b's images are late where they agree best, and the pose then."""
    known = film.times[np.isfinite(film.times)]
    most = int(min(np.ptp(known) / film.spacing / 2, _LONGEST_DELAY))
    best = 0.0, (np.eye(3), np.zeros(3), 0.0, np.inf)
    for step in sorted(range(-most, most + 1), key=abs):
        delay = step * film.spacing
        found = _relative_pose(
            views[a], views[b], a, b, images, film.partners(delay), LEAST_PICTURES
        )
        if found is not None and found[3] < best[1][3]:
            best = delay, found
    return best


def _in_step(
    views: list[SingleCamera], images: dict, film: Film, offset: NDArray
) -> tuple[list[SingleCamera], dict[tuple[int, int], _Image]]:
    """Return views and images filed under the frames whose moments they show."""
    shifted, filed = [], {}
    for camera, view in enumerate(views):
        partner = film.partners(float(offset[camera]))
        rms = np.where((partner >= 0)[:, None], view.rms[partner], np.inf)
        shifted.append(replace(view, R=view.R[partner], t=view.t[partner], rms=rms))
        for frame in np.flatnonzero(partner >= 0):
            if (camera, int(partner[frame])) in images:
                filed[camera, int(frame)] = images[camera, int(partner[frame])]
    return shifted, filed


def _images(
    views: list[SingleCamera], observations: ObservationArrays
) -> dict[tuple[int, int], _Image]:
    """Return the images by camera and frame."""
    pinhole = np.full((len(observations), 2), np.nan)
    focal = [float(np.sqrt(np.prod(np.diag(view.lens.matrix)[:2]))) for view in views]
    for camera, view in enumerate(views):
        own = observations.camera == camera
        pinhole[own] = view.lens.pinhole(observations.uv[own])
    return {
        (camera, frame): _Image(observations.points[rows], pinhole[rows], focal[camera])
        for camera, frame, rows in image_rows(observations)
    }


def _relative_pose(
    one: SingleCamera,
    other: SingleCamera,
    a: int,
    b: int,
    images: dict[tuple[int, int], _Image],
    partner: NDArray[np.int64] | None = None,
    least: int = 1,
) -> tuple[NDArray, NDArray, float, float] | None:
    """Return R, t from the axes of camera a to those of b, the points that agree, and a residual.

    That is the median in pixels; ``partner`` gives b's frame for each of a's, -1 without.
    """
    partner = np.arange(len(one.rms)) if partner is None else partner
    both = (partner >= 0) & np.isfinite(one.rms[:, 0]) & np.isfinite(other.rms[partner, 0])
    shared = np.flatnonzero(both)
    if len(shared) < least:
        return None
    some = shared[np.linspace(0, len(shared) - 1, min(len(shared), _TRIED_FRAMES)).astype(int)]
    candidates = []
    for frame in some:
        for i in range(2):
            for j in range(2):
                late = partner[frame]
                if np.isfinite(one.rms[frame, i]) and np.isfinite(other.rms[late, j]):
                    R = other.R[late, j] @ one.R[frame, i].T
                    candidates.append((R, other.t[late, j] - R @ one.t[frame, i]))
    R = np.array([R for R, _ in candidates])  # (n, 3, 3)
    t = np.array([t for _, t in candidates])
    matched = [images[b, int(partner[frame])] for frame in some]
    errors = np.stack(
        [_errors(one, frame, R, t, image) for frame, image in zip(some, matched, strict=True)]
    )
    best = int(np.argmin(np.log1p(errors).sum(axis=0)))
    weight = sum(
        min(len(images[a, frame].points), len(image.points)) / (1 + (error / 2) ** 2)
        for frame, image, error in zip(some, matched, errors[:, best], strict=True)
    )
    return (
        R[best],
        t[best],
        float(weight * len(shared) / len(some)),
        float(np.median(errors[:, best])),
    )


def _errors(
    one: SingleCamera, frame: int, R: NDArray, t: NDArray, image: _Image
) -> NDArray[np.float64]:
    """Return the RMS residual of relative poses ``(n,)`` in one frame, for the better answer."""
    errors = np.full((2, len(R)), _BEHIND)
    for i in range(2):
        if np.isfinite(one.rms[frame, i]):
            in_one = image.points @ one.R[frame, i].T + one.t[frame, i]
            errors[i] = _pixels(image, in_one @ R.transpose(0, 2, 1) + t[:, None])
    return errors.min(axis=0)


def _pixels(image: _Image, in_camera: NDArray) -> NDArray[np.float64]:
    """Return the RMS residual in pixels of points ``(n, points, 3)`` in an image, ``(n,)``."""
    depth = in_camera[:, :, 2]
    before = (depth > 0).all(axis=1)
    safe = np.where(depth > 0, depth, 1.0)[:, :, None]
    squares = ((in_camera[:, :, :2] / safe - image.pinhole) ** 2).sum(axis=2)
    known = np.isfinite(squares)
    mean = np.where(known, squares, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    return np.where(before, np.minimum(image.focal * np.sqrt(mean), _BEHIND), _BEHIND)


def _with_targets(
    scene: Scene, views: list[SingleCamera], images: dict[tuple[int, int], _Image]
) -> Scene:
    """Return the scene with each frame's pose: of all cameras' answers the one that fits best."""
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
