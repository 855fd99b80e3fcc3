"""Adjustment that outliers do not disturb, and the observations and images that are left out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import Solution, adjust
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    image_rows,
    predicted,
)

LEAST_POINTS = 6  # of an image; fewer leave the pose to the noise
_RAYLEIGH_MEDIAN = round(math.sqrt(2 * math.log(2)), 4)  # of a 2-D normal residual's length
_HUBER = 3.0  # standard deviations, beyond which the loss is linear
_LEAST_NOISE = 1e-3  # pixels; below it exact data would show rounding as outliers
_POINT_LIMIT = 12.0  # residual length in standard deviations; less would cull good points
_IMAGE_LIMIT = 5.0  # times the usual median residual of an image; less would cull good ones
_ROUNDS = 6  # of culling, and of estimating the noise; both settle after two or three


@dataclass(frozen=True)
class Culled:
    """The adjustment without outliers; its residuals are those of the observations used."""

    solution: Solution
    used: NDArray[np.bool_]  # (observations,)


def adjust_and_cull(
    scene: Scene, observations: ObservationArrays, freedom: Freedom, cull: bool
) -> Culled:
    """Return the least-squares adjustment of all observations but gross outliers.

    Outliers are decided anew until none changes; without ``cull`` only those behind are left out.
    """
    ahead = np.asarray(np.isfinite(predicted(scene, observations)).all(axis=1))
    used = supported(observations, ahead)
    scene = adjust_robustly(scene, observations.where(used), freedom, tolerance=1e-4).scene
    if not cull:
        return Culled(adjust(scene, observations.where(used), freedom), used)
    kept = _agreeing(scene, observations, used)
    solution = adjust(scene, observations.where(kept), freedom)
    for _ in range(_ROUNDS - 1):
        scene = solution.scene
        before, kept = kept, _agreeing(scene, observations, used)
        if (kept == before).all():
            break
        if (before & ~kept).any():
            scene = adjust_robustly(scene, observations.where(kept), freedom, tolerance=1e-4).scene
        solution = adjust(scene, observations.where(kept), freedom)
    return Culled(_with_frames_left_out(solution, observations, kept), kept)


def _with_frames_left_out(
    solution: Solution, observations: ObservationArrays, used: NDArray[np.bool_]
) -> Solution:
    """Return the solution with poses for frames left out entirely, so that residuals show why."""
    scene = solution.scene
    before = np.isfinite(predicted(scene, observations)).all(axis=1)
    rest = observations.where(~np.isin(observations.frame, observations.frame[used]) & before)
    if not len(rest):
        return solution
    fixed = Freedom(
        tuple(np.zeros(lens.size, bool) for lens in scene.lenses),
        np.zeros(len(scene.lenses), bool),
    )
    return replace(solution, scene=adjust_robustly(scene, rest, fixed, tolerance=1e-3).scene)


def _agreeing(
    scene: Scene, observations: ObservationArrays, used: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which observations agree with the scene, within their camera's noise."""
    residuals = observations.uv - predicted(scene, observations)
    lengths = np.where(used, np.linalg.norm(residuals, axis=1), np.inf)
    known = np.isfinite(lengths)
    sigma = noise(residuals[known], observations.camera[known], len(scene.lenses))
    relative = lengths / sigma[observations.camera]
    kept = known & (relative < _POINT_LIMIT)
    for _, _, rows in image_rows(observations):
        # 1.18 is the median of agreeing observations
        if np.median(relative[rows]) > 1.18 * _IMAGE_LIMIT:
            kept[rows] = False
    return supported(observations, kept)


def supported(observations: ObservationArrays, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return ``kept`` without the frames that have too few observations left for a pose."""
    counts = np.bincount(observations.frame, kept, int(observations.frame.max(initial=-1)) + 1)
    return kept & (counts[observations.frame] >= LEAST_POINTS)


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

    From a poor start that scale is large: the first iterations are nearly plain least squares.
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
        if steps == _ROUNDS:
            return solution
        if steps > 1 and (np.abs(sigma - before) <= 0.02 * before)[seen].all():
            return solution
