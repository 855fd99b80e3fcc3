"""First poses of all cameras in one world, along the tree of shared views."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.initial import SingleCamera
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, image_rows

_TRIED_FRAMES = 12  # shared by two cameras, whose poses are compared
_BEHIND = 1e6  # pixels: residual of a point behind the camera, larger than any other
_FAR_OFF = 40.0  # pixels of median residual; beyond it two cameras did not see one scene


@dataclass(frozen=True)
class _Image:
    """One camera's observations in one frame, the lens taken out."""

    points: NDArray[np.float64]  # (n, 3)
    pinhole: NDArray[np.float64]  # (n, 2)
    focal: float


def rig_poses(
    names: tuple[str, ...], views: list[SingleCamera], observations: ObservationArrays, frames: int
) -> tuple[Scene, int]:
    """Return the poses of cameras and targets, and which camera holds the axes.

    The axes are those of the camera with most shared views. Each pair of cameras that saw the
    target in one frame gets its relative pose from the shared frame that explains the others
    best; both answers of the flat target are tried. Poses follow the maximum spanning tree of the
    pairs, weighted by the points that agree.

    Parameters
    ----------
    names : tuple of str
        The cameras' names, for errors.
    views : list of View
    observations : ObservationArrays
        In order of camera, then frame.
    frames : int

    Raises
    ------
    ValueError
        Naming the cameras, if no chain of shared frames joins all, or one is not synchronised.
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
    return _with_targets(empty, views, images), root


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
    one: SingleCamera, other: SingleCamera, a: int, b: int, images: dict[tuple[int, int], _Image]
) -> tuple[NDArray, NDArray, float, float] | None:
    """Return R, t from the axes of camera a to those of b, the points that agree, and a residual.

    The residual, in pixels, is the median over the frames that both see.
    """
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
