"""The points of a volume at which a rig is evaluated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene
from rigs.calibrate.quality.ray_miss import views
from rigs.geometry.points import box_points
from rigs.rig import Rig, Volume

_GRID = 9  # points along each side of the box


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
        raise ValueError("volume: found no point of it that two cameras see")
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
