"""How exactly each camera is known against the others, from the covariance of all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import Scene, rays_by_camera
from rigs.calibrate.quality.covariance import root_of
from rigs.figures import Accuracy
from rigs.files.text import plain

_POINTS = 100  # of the volume; six motions need far fewer, more take time
_APART = 1e-3  # least ratio of singular values at which motions differ
_DIGITS = 3  # significant ones, in files


def camera_accuracies(
    scene: Scene,
    freedom: Freedom,
    covariance: NDArray[np.float64],
    points: NDArray[np.float64],
    seen: NDArray[np.bool_],
) -> tuple[Accuracy | None, ...]:
    """Return what the covariance of all cameras says of each.

    Parameters
    ----------
    scene : Scene
    freedom : Freedom
    covariance : (P, P) float64
        The free parameters' covariance, while one camera is held.
    points : (points, 3) float64
        Spread over the volume.
    seen : (cameras, points) bool

    Returns
    -------
    tuple of Accuracy or None
        None for a camera that sees too little of the points to tell its motions apart.

    Notes
    -----
    A change p of the parameters moves the pixels of points by ``du/dp p``. To this the motion of
    the volume is fitted that looks most like it: a shift to the right and down, a turn about each
    axis, a growth. Its six numbers are linear in p. Which camera is held is a choice of the
    adjustment. The rigid motion of the world that leaves least of all cameras' numbers, in pixels,
    is therefore taken out (an S-transformation: Baarda, Netherlands Geodetic Commission,
    Publications on Geodesy 5 (1973)).
    """
    some = slice(None, None, len(points) // _POINTS + 1)
    points, seen = points[some], seen[:, some]
    middle, root = points.mean(axis=0), root_of(covariance)
    axes, centers = np.eye(3), scene.centers()
    errors = np.zeros((len(seen), 6, len(root)))  # in pixels
    rigid, to_pixels = np.zeros((len(seen), 6, 6)), np.ones(len(seen))
    is_known = seen.sum(axis=1) >= 6
    for camera in np.flatnonzero(is_known).tolist():
        about = points[seen[camera]] - middle
        by_point, by_camera = rays_by_camera(scene, camera, about + middle)
        own, by_camera = freedom.gathered(camera, by_camera)
        pixel = np.sqrt(np.square(by_point).sum(axis=(1, 2)).mean() / 2)  # pixels of a length
        to_pixels[camera] = pixel * np.sqrt(np.square(about).sum(axis=1).mean())
        view = _view(middle - centers[camera], scene.camera_R[camera])
        motions = [_shifts(view[:2], about) / pixel, _turns(view, about), about[:, :, None]]
        motions[1:] = [one / to_pixels[camera] for one in motions[1:]]
        changes = np.concatenate(by_point @ np.concatenate(motions, axis=2))
        strength = np.linalg.svd(changes, compute_uv=False)
        is_known[camera] = strength[-1] > _APART * strength[0]
        inverse = np.linalg.pinv(changes)
        errors[camera] = inverse @ np.concatenate(by_camera @ root[own])
        world = np.concatenate([_shifts(axes, about), _turns(axes, about)], axis=2)
        rigid[camera] = inverse @ np.concatenate(by_point @ world)
    common = np.linalg.lstsq(rigid.reshape(-1, 6), errors.reshape(-1, len(root)), rcond=1e-9)[0]
    right, down, *turns, growth = np.sqrt(np.square(errors - rigid @ common).sum(axis=2)).T
    aside, above, roll = np.rad2deg(turns / to_pixels)
    found = np.hypot(right, down), roll, growth / to_pixels, np.hypot(aside, above)
    both = np.sqrt(0.5)  # of two directions alike
    return tuple(
        Accuracy(*plain([both * a, b, c, both * d], _DIGITS)) if known else None
        for known, a, b, c, d in zip(is_known, *found, strict=True)
    )


def _view(sight: NDArray[np.float64], R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axes right, down and along a line of sight, ``(3, 3)``."""
    ahead = sight / np.linalg.norm(sight)
    right = np.cross(R[1], ahead)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def _shifts(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the motions of points along some axes, ``(points, 3, axes)``."""
    return np.broadcast_to(axes.T, (len(points), 3, len(axes)))


def _turns(axes: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the motions of points by turns about axes, ``(points, 3, 3)``."""
    return np.stack([np.cross(axis, points) for axis in axes], axis=2)
