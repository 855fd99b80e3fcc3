"""Where a rig is judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.observation_arrays import Scene, Sightings
from rigs.calibrate.quality.ray_miss import views
from rigs.geometry.points import box_points
from rigs.rig import Rig, Volume

_GRID = 9  # points a side of the box


def judged_points(
    rig: Rig, scene: Scene, sightings: Sightings, volume: Volume | None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return points of the volume that two cameras see, and which cameras see them.

    Without a volume: a grid in the convex hull of all places where the target was seen.

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
        points = _swept(scene, sightings)
    seen = views(rig, points)
    good = seen.sum(axis=0) > 1
    if volume is not None and not good.any():
        raise ValueError("volume: found no point of it that two cameras see")
    return points[good], seen[:, good]


def _swept(scene: Scene, sightings: Sightings) -> NDArray[np.float64]:
    """Return a grid in the convex hull of the target's points, or these where they are flat."""
    from scipy.spatial import Delaunay, QhullError

    frames = sightings.frame
    places = np.einsum("nij,nj->ni", scene.target_R[frames], sightings.points)
    places += scene.target_t[frames]
    grid = box_points(places.min(axis=0), places.max(axis=0), _GRID)
    try:
        inside = Delaunay(places[:: max(1, len(places) // 3000)]).find_simplex(grid) >= 0
    except QhullError:
        inside = np.zeros(len(grid), bool)
    return grid[inside] if inside.any() else places[:: max(1, len(places) // 300)]
