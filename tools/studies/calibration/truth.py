"""An estimated rig against the true one, free of where either has put its world."""

from __future__ import annotations

from dataclasses import replace

from rigs import Rig, Volume, box_points, ray_miss
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
    corners = volume.corners()
    points = box_points(corners[0], corners[-1], points_per_side)
    return ray_miss(true, estimated, points)


def in_metres(observations: Observations) -> Observations:
    """Return observations of a target in millimetres with its points in metres."""
    return replace(observations, target_points=observations.target_points / 1000)


def of_complete_targets(observations: Observations) -> Observations:
    """Return the observations in images that show every point of the target."""
    complete = observations.counts() == len(observations.target_points)  # (cameras, frames)
    return observations.where(complete[observations.camera, observations.frame])
