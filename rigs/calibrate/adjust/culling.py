"""Sightings and whole images that do not belong to the rest."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import Solution, adjust
from rigs.calibrate.adjust.observation_arrays import (
    Freedom,
    Scene,
    Sightings,
    image_rows,
    predicted,
)
from rigs.calibrate.adjust.robust import adjust_robustly, noise
from rigs.calibrate.adjust.target_pose import LEAST_POINTS

_POINT_LIMIT = 12.0  # standard deviations a coordinate, of a sighting's length
_IMAGE_LIMIT = 5.0  # times the usual, of an image's median length
_ROUNDS = 5


@dataclass(frozen=True)
class Kept:
    """The adjustment of what was kept.

    Parameters
    ----------
    solution : Solution
        Of the sightings that were used, in their order.
    used : (sightings,) bool
    """

    solution: Solution
    used: NDArray[np.bool_]


def adjust_and_cull(scene: Scene, sightings: Sightings, freedom: Freedom, cull: bool) -> Kept:
    """Return the least-squares adjustment of all sightings but gross outliers.

    First with Huber's loss; then sightings and images far beyond their camera's noise are left
    out, the rest is adjusted by plain least squares, and what was left out is judged anew, until
    nothing changes. Without ``cull`` all that can be seen at all is kept.
    """
    used = _supported(sightings, np.isfinite(predicted(scene, sightings)).all(axis=1))
    scene = adjust_robustly(scene, sightings.where(used), freedom, tolerance=1e-4).scene
    if not cull:
        return Kept(adjust(scene, sightings.where(used), freedom), used)
    before = None
    for _ in range(_ROUNDS):
        kept = _agreeing(scene, sightings, used)
        if before is not None and (kept == before).all():
            break
        robust = before is None or (before & ~kept).any()
        if before is not None and robust:
            scene = adjust_robustly(scene, sightings.where(kept), freedom, tolerance=1e-4).scene
        solution = adjust(scene, sightings.where(kept), freedom)
        scene, before = solution.scene, kept
    return Kept(_with_frames_left_out(solution, sightings, before), before)


def _with_frames_left_out(
    solution: Solution, sightings: Sightings, used: NDArray[np.bool_]
) -> Solution:
    """Return the solution with poses for frames left out as a whole, to show by how much."""
    scene = solution.scene
    before = np.isfinite(predicted(scene, sightings)).all(axis=1)
    rest = sightings.where(~np.isin(sightings.frame, sightings.frame[used]) & before)
    if not len(rest):
        return solution
    fixed = Freedom(
        tuple(np.zeros(lens.size, bool) for lens in scene.lenses),
        np.zeros(len(scene.lenses), bool),
    )
    return replace(solution, scene=adjust_robustly(scene, rest, fixed, tolerance=1e-3).scene)


def _agreeing(scene: Scene, sightings: Sightings, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Say which sightings agree with the scene, within their camera's noise."""
    residuals = sightings.uv - predicted(scene, sightings)
    lengths = np.where(used, np.linalg.norm(residuals, axis=1), np.inf)
    known = np.isfinite(lengths)
    sigma = noise(residuals[known], sightings.camera[known], len(scene.lenses))
    relative = lengths / sigma[sightings.camera]
    kept = known & (relative < _POINT_LIMIT)
    for _, _, rows in image_rows(sightings):
        # 1.18 is the median of agreeing sightings
        if np.median(relative[rows]) > 1.18 * _IMAGE_LIMIT:
            kept[rows] = False
    return _supported(sightings, kept)


def _supported(sightings: Sightings, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return ``kept`` without the frames that have too few sightings left for a pose."""
    counts = np.bincount(sightings.frame, kept, int(sightings.frame.max(initial=-1)) + 1)
    return kept & (counts[sightings.frame] >= LEAST_POINTS)
