"""How far off a rig says its cameras may be, in pixels of their images."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs import Accuracy, CameraLike, Rig
from rigs.calibration_record import recorded
from rigs.check.rig_check import calibrated_ray_miss
from tomo.grid import VoxelGrid

NOMINAL = Accuracy(shift=5.0, roll=1.0, magnification=0.03, direction=1.0)
"""Errors of cameras whose places are those of a drawing: pixels, degrees, a fraction. Less, they
hold the scene beside calibrated cameras; more, only these do."""


def stated_errors(rig: Rig, grid: VoxelGrid, pixel: float = 1.0) -> NDArray[np.float64]:
    """Return standard deviations of the parameters of `tomo.model.Pose`, ``(views, 6)``.

    They are those of each camera's `rigs.Accuracy`. What that lacks follows from the figures of
    the rig's calibration: the ray-miss at the middle of the grid, and for the magnification the
    error of the focal length. Where these are missing too it is that of `NOMINAL` for a nominal
    camera, and zero for others.

    Parameters
    ----------
    rig : Rig
    grid : VoxelGrid
    pixel : float
        Width of a pixel, in those of the images as recorded.
    """
    found = []
    for camera, footprint in zip(rig, rig.footprint(grid.center), strict=True):
        radius = min(camera.image_size) / 2
        if camera.status == "nominal":
            usual = NOMINAL.with_pixels_scaled(pixel)
        else:
            usual = _of_calibration(rig, camera, float(footprint), radius)
        known = {n: v for n, v in vars(camera.accuracy or Accuracy()).items() if v is not None}
        one = replace(usual, **known)
        roll, direction = (radius * np.deg2rad(angle) for angle in (one.roll, one.direction))
        zoom = radius * one.magnification
        found.append([one.shift, one.shift, roll, zoom, direction, direction])
    return np.array(found, np.float64)


def _of_calibration(rig: Rig, camera: CameraLike, footprint: float, radius: float) -> Accuracy:
    """Return the accuracy that the figures of a rig's calibration come to."""
    pixels = (calibrated_ray_miss(rig, camera.name) or 0.0) / footprint
    if not math.isfinite(pixels):  # the grid is behind the camera
        pixels = 0.0
    focal = recorded(rig, "focal_length_error", camera.name) or pixels / radius
    angle = np.rad2deg(pixels / radius)
    return Accuracy(pixels, angle, focal, angle)
