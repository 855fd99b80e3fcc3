"""Adjustment in the presence of sightings that are wrong."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import Solution, adjust
from rigs.calibrate.adjust.observation_arrays import Freedom, Scene, Sightings, predicted

_RAYLEIGH_MEDIAN = 1.1774  # of the length of a residual, in standard deviations a coordinate
_HUBER = 3.0  # standard deviations
_ROUNDS = 6
_LEAST_NOISE = 1e-3  # pixels: exact data are not searched for outliers below


def noise(
    residuals: NDArray[np.float64], camera: NDArray[np.int64], cameras: int
) -> NDArray[np.float64]:
    """Return each camera's pixel noise a coordinate, from the median of its residuals' lengths.

    NaN where a camera has no residuals.
    """
    lengths = np.linalg.norm(residuals, axis=1)
    sigma = np.full(cameras, np.nan)
    for index in np.unique(camera):
        sigma[index] = np.median(lengths[camera == index]) / _RAYLEIGH_MEDIAN
    return np.where(np.isnan(sigma), np.nan, np.maximum(sigma, _LEAST_NOISE))


def adjust_robustly(
    scene: Scene,
    sightings: Sightings,
    freedom: Freedom,
    *,
    tolerance: float = 1e-6,
    iterations: int = 30,
) -> Solution:
    """Return the scene of least Huber loss, whose scale follows each camera's own noise.

    From a poor start all residuals are large and so is the scale: the first rounds are least
    squares but for what is far off.
    """
    residuals = sightings.uv - predicted(scene, sightings)
    cameras = len(scene.lenses)
    sigma = noise(residuals, sightings.camera, cameras)
    solution = None
    for round_ in range(_ROUNDS):
        huber = (_HUBER * sigma)[sightings.camera]
        solution = adjust(
            scene,
            sightings,
            freedom,
            huber=huber,
            tolerance=1e-3 if round_ == 0 else tolerance,
            iterations=iterations,
        )
        scene = solution.scene
        before, sigma = sigma, noise(solution.residuals, sightings.camera, cameras)
        seen = np.isfinite(sigma)
        if round_ and (np.abs(sigma - before) <= 0.02 * before)[seen].all():
            break
    return solution
