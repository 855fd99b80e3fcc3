"""What a covariance predicts in the volume: ray-miss, and how exactly each camera is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, rays_by_camera
from rigs.calibrate.quality.covariance import root_of
from rigs.check.resolved_wavelength import SAMPLE
from rigs.figures import Accuracy
from rigs.files.text import plain
from rigs.geometry.points import ALONG, box_points
from rigs.rig import Rig, Volume

_BLOCK = 64  # points at a time; more need more memory
_APART = 1e-3  # least ratio of singular values at which motions differ
_DIGITS = 3  # significant ones, in files


def views(rig: Rig, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which camera has which of ``points`` in its image, ``(cameras, points)``."""
    seen = np.zeros((len(rig), len(points)), bool)
    for index, camera in enumerate(rig):
        seen[index] = camera.inside(camera.project(points)[0])
    return seen


def predicted_squares(
    scene: Scene,
    freedom: Freedom,
    covariance: NDArray[np.float64],
    points: NDArray[np.float64],
    seen: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return expected squared distances of rays from their common point, ``(cameras, points)``.

    A small change p of the parameters shifts the ray through a fixed pixel, where it passes point
    X, by ``e = -pinv(du/dX) du/dp p`` across the ray. The common point is the least-squares one of
    all shifted rays, so the distances are linear in p and their expected squares follow from the
    joint covariance ``(P, P)``. A common motion of the whole rig cancels. Two or more cameras see
    each of ``points`` ``(points, 3)``; the squares are 0 where not seen.
    """
    root = root_of(covariance)
    squares = np.zeros(seen.shape)
    for start in range(0, len(points), _BLOCK):
        block = slice(start, start + _BLOCK)
        squares[:, block] = _block_squares(scene, freedom, root, points[block], seen[:, block])
    return squares


def _block_squares(
    scene: Scene, freedom: Freedom, root: NDArray, points: NDArray, seen: NDArray
) -> NDArray[np.float64]:
    """Return `predicted_squares` of some points; ``root`` ``(P, P)`` is the covariance's root."""
    shifts = np.zeros((len(scene.lenses), len(points), 3, len(root)))
    across = np.zeros((len(scene.lenses), len(points), 3, 3))
    for camera in range(len(scene.lenses)):
        rows = seen[camera]
        by_point, by_camera = rays_by_camera(scene, camera, points[rows])
        own, by_camera = freedom.gathered(camera, by_camera)
        back = np.linalg.pinv(by_point)  # (n, 3, 2)
        shifts[camera, rows] = -back @ (by_camera @ root[own])
        across[camera, rows] = back @ by_point
    nearest = _inverse(across.sum(axis=0)) @ shifts.sum(axis=0)  # (points, 3, P)
    miss = across @ nearest - shifts
    return (miss**2).sum(axis=(2, 3))


def _inverse(matrices: NDArray) -> NDArray[np.float64]:
    """Return the inverses ``(n, 3, 3)``; zero along rays that are all parallel."""
    return np.linalg.pinv(matrices, rcond=1e-9, hermitian=True)


def evaluation_points(
    rig: Rig, scene: Scene, observations: ObservationArrays, volume: Volume | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return points of the volume ``(points, 3)`` that two cameras see, and which see them.

    Without a volume they are a grid in the convex hull of all observed target points.
    """
    if len(rig) < 2:
        return np.zeros((0, 3)), np.zeros((len(rig), 0), bool)
    if volume is not None:
        corners = volume.corners()
        points = box_points(corners[0], corners[-1], ALONG)
    else:
        points = _swept(scene, observations)
    seen = views(rig, points)
    good = seen.sum(axis=0) > 1
    if volume is not None and not good.any():
        middle = ", ".join(f"{x:.4g}" for x in _swept(scene, observations).mean(axis=0))
        raise ValueError(
            "volume: found no point of it that two cameras see, expected its center near "
            f"({middle}), where the target was; the world is: {rig.world_frame}"
        )
    return points[good], seen[:, good]


def _swept(scene: Scene, observations: ObservationArrays) -> NDArray[np.float64]:
    """Return a grid in the convex hull of the target's points, or these where they are flat."""
    from scipy.spatial import Delaunay, QhullError

    frames = observations.frame
    of_frame = np.zeros((len(scene.target_t), len(scene.lenses)), bool)
    of_frame[frames, observations.camera] = True
    shared = (of_frame.sum(axis=1) > 1)[frames]
    if shared.any():  # images of one camera alone, close to it, say nothing of the volume
        observations, frames = observations.where(shared), frames[shared]
    positions = np.einsum("nij,nj->ni", scene.target_R[frames], observations.points)
    positions += scene.target_t[frames]
    grid = box_points(positions.min(axis=0), positions.max(axis=0), ALONG)
    try:
        inside = Delaunay(positions[:: max(1, len(positions) // 3000)]).find_simplex(grid) >= 0
    except QhullError:
        inside = np.zeros(len(grid), bool)
    return grid[inside] if inside.any() else positions[:: max(1, len(positions) // 300)]


def camera_accuracies(
    scene: Scene,
    freedom: Freedom,
    covariance: NDArray[np.float64],
    points: NDArray[np.float64],
    seen: NDArray[np.bool_],
) -> tuple[Accuracy | None, ...]:
    """Return what the covariance ``(P, P)`` of all cameras says of each; None where motions mix.

    A change p of the parameters moves the pixels of points by ``du/dp p``. To this the motion of
    the volume is fitted that looks most like it: a shift to the right and down, a turn about each
    axis, a growth. Its six numbers are linear in p. Which camera is held is a choice of the
    adjustment. The rigid motion of the world that leaves least of all cameras' numbers, in pixels,
    is therefore taken out (an S-transformation: Baarda, Netherlands Geodetic Commission,
    Publications on Geodesy 5 (1973)). ``points`` ``(points, 3)`` are spread over the volume;
    ``seen`` is ``(cameras, points)``.
    """
    some = slice(None, None, len(points) // SAMPLE + 1)
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
