"""Points of the volume, and the ray-miss there that a covariance predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, rays_by_camera
from rigs.calibrate.quality.covariance import root_of
from rigs.geometry.points import box_points
from rigs.rig import Rig, Volume

_GRID = 9  # points along each side of the box
_BLOCK = 64  # points at a time; more need more memory


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
    """Return the expected squared distances of rays, from the covariance of all cameras.

    A small change p of the parameters shifts the ray through a fixed pixel, where it passes point
    X, by ``e = -pinv(du/dX) du/dp p`` across the ray. The common point is the least-squares one
    of all shifted rays, so the distances are linear in p and their expected squares follow from
    the joint covariance. A common motion of the whole rig cancels.

    Parameters
    ----------
    scene : Scene
    freedom : Freedom
    covariance : (P, P) float64
        The free parameters' covariance.
    points : (points, 3) float64
    seen : (cameras, points) bool
        Two or more cameras for each point.

    Returns
    -------
    (cameras, points) float64
        In squared length units; 0 where not seen.
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
    """Return points of the volume that two cameras see, and which cameras see them.

    Without a volume the points are a grid in the convex hull of all observed target points.

    Returns
    -------
    points : (points, 3) float64
    seen : (cameras, points) bool
    """
    if len(rig) < 2:
        return np.zeros((0, 3)), np.zeros((len(rig), 0), bool)
    if volume is not None:
        corners = volume.corners()
        points = box_points(corners[0], corners[-1], _GRID)
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
    grid = box_points(positions.min(axis=0), positions.max(axis=0), _GRID)
    try:
        inside = Delaunay(positions[:: max(1, len(positions) // 3000)]).find_simplex(grid) >= 0
    except QhullError:
        inside = np.zeros(len(grid), bool)
    return grid[inside] if inside.any() else positions[:: max(1, len(positions) // 300)]
