"""Standard deviations of a bootstrap, calibrated by a second bootstrap."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels

WIDTHS = (0.8, 1.5)
"""Standard deviations, in voxels, of the blurs that describe a voxel's surroundings."""

FLOOR = 1e-3
"""Fraction of a large deviation, or of the emission's root mean square, to which smaller ones are
raised before the logarithm."""

LARGE = 0.9
"""Quantile of all deviations that counts as a large one."""

OUTLIER = 0.4
"""Error of a deviation's logarithm (a factor 1.5) beyond which a voxel weighs less in the fit."""

REWEIGHTINGS = 10
VOXELS_IN_FIT = 50_000

RIDGE = 1e-3
"""Ridge, as a fraction of a voxel's weight, that pulls each coefficient to 0, no correction."""


@dataclass(frozen=True, eq=False)
class Spread:
    """Mean and deviation of the repeats of a solve, voxel by voxel.

    Both are (unknowns,) float64.
    """

    deviation: NDArray[np.float64]
    mean: NDArray[np.float64]


def calibrated(first: Spread, second: Spread, active: ActiveVoxels) -> NDArray[np.float64]:
    """Return standard deviations (unknowns,), corrected for the bootstrap's bias on this scene.

    The double bootstrap (Beran, "Prepivoting to reduce level error of confidence sets", Biometrika
    74, 1987; Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 18). The
    second one's repeats, around one of the first's noisy images, treat these as the first does the
    measured ones, and here the answer is known: it is the first. What is fitted is

        log(first deviation / second deviation) = q(features of the second)

    with a quadratic polynomial q, the same for all voxels, of the logarithms of a voxel's
    deviation and mean, plain and blurred by `WIDTHS`. The first's own deviations are then
    multiplied by exp(q(features of the first)). So the scene says how far a voxel is to be drawn
    to what its surroundings suggest: far where noise decides how firmly it is held at zero, hardly
    where it emits. The fit is by iteratively reweighted least squares with Cauchy's weights
    (Holland and Welsch, "Robust regression using iteratively reweighted least-squares", 1977).
    """
    scale = float(np.quantile(first.deviation, LARGE))
    if scale == 0:
        return first.deviation
    known, tried = (_features(spread, scale, active) for spread in (first, second))
    chosen = slice(None, None, -(-active.size // VOXELS_IN_FIT))
    coefficients = _fitted([feature[chosen] for feature in tried], (known[0] - tried[0])[chosen])
    terms = zip(_terms(known), coefficients, strict=True)
    found = scale * np.exp(known[0] + sum(factor * term for term, factor in terms))
    moved = neighbour_means(first.deviation, WIDTHS[0], active) > 0
    return np.where(moved, found, 0.0)


def neighbour_means(
    values: NDArray[np.float64], width: float, active: ActiveVoxels
) -> NDArray[np.float64]:
    """Return the Gaussian means (unknowns,) of a voxel and its neighbours that are unknown."""
    from scipy.ndimage import gaussian_filter

    def blurred(unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        volume = active.expand(unknowns).reshape(active.grid.shape)
        return active.compress(gaussian_filter(volume, width, mode="constant"))

    return blurred(values) / blurred(np.ones_like(values))


def _features(spread: Spread, scale: float, active: ActiveVoxels) -> list[NDArray[np.float64]]:
    """Return the logarithms of deviation and mean, plain and blurred, (unknowns,) each."""
    plain = [np.log(np.maximum(own / scale, FLOOR)) for own in (spread.deviation, spread.mean)]
    return plain + [neighbour_means(own, width, active) for own in plain for width in WIDTHS]


def _terms(features: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return constant, linear and quadratic terms."""
    pairs = combinations_with_replacement(features, 2)
    return [np.ones_like(features[0]), *features, *(one * other for one, other in pairs)]


def _fitted(
    features: list[NDArray[np.float64]], target: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the polynomial's coefficients."""
    terms = np.stack(_terms(features))  # (terms, voxels)
    hold = RIDGE * np.eye(len(terms))
    weights = np.ones_like(target)
    for _ in range(REWEIGHTINGS):
        weighted = weights * terms
        # einsum adds in one order whatever the number of threads, a matrix product may not
        normal = np.einsum("iv,jv->ij", weighted, terms)
        coefficients = np.linalg.solve(normal + hold, np.einsum("iv,v->i", weighted, target))
        error = target - np.einsum("i,iv->v", coefficients, terms)
        weights = 1 / (1 + (error / OUTLIER) ** 2)
    return coefficients
