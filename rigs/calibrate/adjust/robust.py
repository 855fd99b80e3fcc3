"""Adjustment with Huber's loss, which outliers disturb little."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import Solution, adjust
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted

_RAYLEIGH_MEDIAN = 1.1774  # median length of a 2-D normal residual, in standard deviations
_HUBER = 3.0  # standard deviations, beyond which the loss is linear
_ITERATIONS = 6  # of estimating the noise; it settles after two or three
_LEAST_NOISE = 1e-3  # pixels; below it exact data would show rounding as outliers


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
    observations: ObservationArrays,
    freedom: Freedom,
    *,
    tolerance: float = 1e-6,
    iterations: int = 30,
) -> Solution:
    """Return the scene of least Huber loss, whose scale follows each camera's own noise.

    From a poor start all residuals are large and so is the scale: the first iterations are nearly
    plain least squares.
    """
    residuals = observations.uv - predicted(scene, observations)
    cameras = len(scene.lenses)
    sigma = noise(residuals, observations.camera, cameras)
    steps = 0
    while True:
        huber = (_HUBER * sigma)[observations.camera]
        solution = adjust(
            scene,
            observations,
            freedom,
            huber=huber,
            tolerance=1e-3 if steps == 0 else tolerance,
            iterations=iterations,
        )
        scene = solution.scene
        before, sigma = sigma, noise(solution.residuals, observations.camera, cameras)
        steps += 1
        seen = np.isfinite(sigma)
        if steps == _ITERATIONS:
            return solution
        if steps > 1 and (np.abs(sigma - before) <= 0.02 * before)[seen].all():
            return solution
