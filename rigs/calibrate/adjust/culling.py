"""Outliers: observations and whole images that disagree with the rest."""

from __future__ import annotations

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
from rigs.calibrate.adjust.robust import adjust_robustly, noise
from rigs.calibrate.adjust.target_pose import LEAST_POINTS

_POINT_LIMIT = 12.0  # residual length in standard deviations; less would cull good points
_IMAGE_LIMIT = 5.0  # times the usual median residual of an image; less would cull good ones
_ITERATIONS = 5  # of culling; it settles after two or three


@dataclass(frozen=True)
class Culled:
    """The adjustment without outliers.

    Parameters
    ----------
    solution : Solution
        Its residuals are those of the observations used, in their order.
    used : (observations,) bool
    """

    solution: Solution
    used: NDArray[np.bool_]


def adjust_and_cull(
    scene: Scene, observations: ObservationArrays, freedom: Freedom, cull: bool
) -> Culled:
    """Return the least-squares adjustment of all observations but gross outliers.

    First comes an adjustment with Huber's loss. Observations and images far beyond their camera's
    noise are then left out and the rest is adjusted by plain least squares. Outliers are decided
    anew after each adjustment, until none changes. Without ``cull`` every observation is kept
    that lies before its camera.
    """
    ahead = np.asarray(np.isfinite(predicted(scene, observations)).all(axis=1))
    used = _supported(observations, ahead)
    scene = adjust_robustly(scene, observations.where(used), freedom, tolerance=1e-4).scene
    if not cull:
        return Culled(adjust(scene, observations.where(used), freedom), used)
    kept = _agreeing(scene, observations, used)
    solution = adjust(scene, observations.where(kept), freedom)
    for _ in range(_ITERATIONS - 1):
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
    return _supported(observations, kept)


def _supported(observations: ObservationArrays, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return ``kept`` without the frames that have too few observations left for a pose."""
    counts = np.bincount(observations.frame, kept, int(observations.frame.max(initial=-1)) + 1)
    return kept & (counts[observations.frame] >= LEAST_POINTS)
