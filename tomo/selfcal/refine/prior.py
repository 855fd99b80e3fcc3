"""How far a camera may be from what its rig says: the prior of a refinement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Rig, box_points
from rigs.check.rig_check import calibrated_ray_miss
from tomo.grid import VoxelGrid

STATUS = {"calibrated": 2.0, "virtual": 2.0, "nominal": 10.0}
"""Pixels by which each part of a camera's parameters may move the image of the volume, as a
standard deviation, by the status of the camera; where the rig holds no figures."""

CAUTION = 3.0
"""A calibration's own figure is taken so many times: it knows of its noise alone."""

SHORTEST = 0.1  # pixels
GAIN_PRIOR = 0.1
"""Standard deviation of a gain's logarithm."""


def prior_lengths(rig: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return each camera's prior in pixels, ``(cameras,)``.

    From the ray-miss that the rig's calibration predicts for the camera (``rig.calibration``, as
    `rigs.calibrate.calibrate` writes it), three times and no less than 0.1 pixel; else, and where
    the rig counts in another unit by now, 2 pixels, or 10 for a camera whose status is nominal.
    """
    footprints = rig.footprint(grid.center)
    lengths = []
    for camera, footprint in zip(rig, footprints, strict=True):
        known = calibrated_ray_miss(rig, camera.name)
        if known is None or camera.status == "nominal" or not footprint > 0:
            lengths.append(STATUS[camera.status])
        else:
            lengths.append(max(CAUTION * known / footprint, SHORTEST))
    return np.array(lengths)


def units(camera: Camera, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return what one pixel is in each parameter: ``(8,)``.

    Position: a pixel's size at the volume, along every axis. Turns right and down: a pixel over
    the focal length. Roll and the focal length's logarithm: what moves the volume's image by a
    pixel, RMS. The gain's logarithm: as it is.

    Position and turn are parts of their own: seen from the volume a camera that is aside and
    turned back is in another direction, which the prior allows only as far as each part.
    """
    points = box_points(grid.lower, grid.upper, 2)
    focal = float(np.sqrt(camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]))
    depth = abs(float(camera.R[2] @ np.asarray(grid.center) + camera.t[2]))
    seen, _, valid = camera.project(points)
    seen = seen[valid & np.isfinite(seen).all(axis=1)]
    # uniform over a box: a third of the corners' mean square distance from the middle
    spread = np.sum(np.square(seen - seen.mean(axis=0))) / 3 / len(seen) if len(seen) else 0.0
    radius = max(float(np.sqrt(spread)), 1.0)
    place = [*[max(depth / focal, 1e-12)] * 3, 1 / focal, 1 / focal, 1 / radius, 1 / radius]
    return np.array([*place, 1.0])
