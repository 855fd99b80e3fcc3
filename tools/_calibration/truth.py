"""An estimated rig against the true one, free of where either has put its world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, Volume, ray_miss
from rigs.calibrate import Observations


def true_ray_miss(true: Rig, estimated: Rig, volume: Volume, points_per_side: int = 5) -> float:
    """Return the RMS distance of estimated rays from their best common point.

    Points of the volume are projected with the true cameras, and the pixels cast back with the
    estimated ones of the same names.

    Parameters
    ----------
    true : Rig
        In whose world the volume is.
    estimated : Rig
        In any world and unit: the distance comes in that unit.
    volume : Volume
    points_per_side : int
        Of the grid of points, the volume's faces included.
    """
    return ray_miss(true, estimated, _points(volume, points_per_side))


def in_metres(observations: Observations) -> Observations:
    """Return sightings of a target in millimetres with its points in metres."""
    return replace(observations, target_points=observations.target_points / 1000)


def of_complete_targets(observations: Observations) -> Observations:
    """Return the sightings in images that show every point of the target."""
    complete = observations.counts() == len(observations.target_points)  # (cameras, frames)
    return observations.where(complete[observations.camera, observations.frame])


def _points(volume: Volume, count: int) -> NDArray[np.float64]:
    """Return a grid of points over a volume, ``(count ** 3, 3)``."""
    low, high = volume.corners().min(axis=0), volume.corners().max(axis=0)
    axes = [np.linspace(low[k], high[k], count) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
