"""The prior of a refinement: standard deviations of a camera's departure from its rig."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Rig, box_points
from rigs.check.rig_check import calibrated_ray_miss
from tomo.grid import VoxelGrid

STATUS = {"calibrated": 2.0, "virtual": 2.0, "nominal": 10.0}
"""Standard deviation by camera status, in pixels of image motion per parameter, for rigs without
calibration figures. Smaller, real errors stay; larger, undetermined parameters drift."""

CAUTION = 3.0
"""Factor on a calibration's predicted ray-miss, which counts noise alone. Smaller, systematic
errors stay; larger, a good calibration is given up."""

SHORTEST = 0.1
"""Least standard deviation in pixels. Smaller, cameras cannot move at all; larger, the prior of a
good calibration has no effect."""

GAIN_PRIOR = 0.1
"""Standard deviation of a gain's logarithm. Smaller, unequal gains stay; larger, gains drift."""


def prior_lengths(rig: Rig, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the standard deviation of each camera's prior in pixels, ``(cameras,)``.

    It is three times the ray-miss that the rig's calibration predicts for the camera
    (``rig.calibration``, as `rigs.calibrate.calibrate` writes it), and at least 0.1 pixels. Where
    the calibration has no figure, or one in another length unit, it is 2 pixels, and 10 pixels
    for a camera whose status is nominal.
    """
    footprints = rig.footprint(grid.center)
    lengths = []
    for camera, footprint in zip(rig, footprints, strict=True):
        ray_miss = calibrated_ray_miss(rig, camera.name)
        if ray_miss is None or camera.status == "nominal" or not footprint > 0:
            lengths.append(STATUS[camera.status])
        else:
            lengths.append(max(CAUTION * ray_miss / footprint, SHORTEST))
    return np.array(lengths)


def units(camera: Camera, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the size of each parameter that moves the image by one pixel: ``(8,)``.

    Position: the size of a pixel at the volume, along every axis. Rotation about the axes right
    and down: one pixel over the focal length. Roll and the logarithm of the focal length: the
    value that moves the volume's image by one pixel, RMS. The logarithm of the gain: 1.

    Notes
    -----
    Position and rotation have separate priors, although together they may cancel in the image. A
    camera moved sideways and turned back views the volume from another direction, and the prior
    limits this through each of the two.
    """
    points = box_points(grid.lower, grid.upper, 2)
    focal = float(np.sqrt(camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]))
    depth = abs(float(camera.R[2] @ np.asarray(grid.center) + camera.t[2]))
    projected, _, valid = camera.project(points)
    projected = projected[valid & np.isfinite(projected).all(axis=1)]
    # uniform over a box: a third of the corners' mean square distance from the middle
    spread = (
        np.sum(np.square(projected - projected.mean(axis=0))) / 3 / len(projected)
        if len(projected)
        else 0.0
    )
    radius = max(float(np.sqrt(spread)), 1.0)
    geometry = [*[max(depth / focal, 1e-12)] * 3, 1 / focal, 1 / focal, 1 / radius, 1 / radius]
    return np.array([*geometry, 1.0])
