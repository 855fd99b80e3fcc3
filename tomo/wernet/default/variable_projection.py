"""Gains and global terms of a scene, found with the voxels eliminated."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.reductions import dot
from tomo.selection import Choice, choose_by_left_out_pixels
from tomo.wernet.default.correction import ViewParameters
from tomo.wernet.default.linearisation import Linearisation, PixelSubset
from tomo.wernet.default.patch_validation import left_out_patch_residuals
from tomo.wernet.default.patches import beyond_noise, noise_along_a_term
from tomo.wernet.default.ray_features import TERMS

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator

STEPS = 6
"""Gauss-Newton steps at most; a fit settles in two or three."""

PIXELS_PER_UNKNOWN = 12
"""Pixels an unknown above which some are skipped. Fewer: less exact terms. More: time."""

PRIOR = 0.3
"""Prior standard deviation of the logarithm of a weight. Smaller: true terms are shrunk. Larger:
terms of dark views become arbitrary."""

SETTLED = 0.995
"""Steps end when the next is predicted to leave more than this fraction of the patch misfit."""

GAINS = len(TERMS)
"""Number of the views' gains among the candidates, after those of the terms."""

VIGNETTING = len(TERMS) - 1
FINE = 16
"""Pixels a patch from which on vignetting is a candidate. Voxels imitate nearly all of it; with
fewer pixels the error of coarse pixels looks like it."""

PROMISING = {1: 0.975, 2: 0.92}
"""Skip a candidate term if its first Gauss-Newton step is predicted to reduce the patch misfit by
less than 2.5 % (8 % for a pair). Larger reductions miss vignetting; smaller ones try terms that
are not there."""

WORTH_OF_GAINS = 0.85
"""Factor to which gains must lower the patch residual of left-out views. Larger: a dozen views'
gains fit noise. Smaller: true gains are refused."""

WORTH_OF_A_TERM = 0.94
"""The same for a term, its effect on the misfit of all views multiplied in: left-out views alone
hardly show vignetting."""

NO_WORSE = 1.05
"""Factor by which a term may predict left-out views worse if it explains enough of all views. The
error of volumes from few views changes by as much."""


class Step(NamedTuple):
    """A Gauss-Newton step, and the patch misfit beyond noise before and after it.

    The noise counts less what terms and gains explain of it by chance.
    """

    coefficients: dict[int, float]
    log_gains: NDArray[np.float64]
    before: float
    after: float


def fit_parametric_terms(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    choice: Choice,
    unit: float,
    image_scale: tuple[float, float] | None = None,
) -> ViewParameters | None:
    """Return the gains and coefficients that predict left-out views best; None if none does.

    Parameters
    ----------
    projector : ProjectionOperator
        Its entries are segment lengths and its segments have midpoints.
    measured : (pixels,) float32
    choice : Choice
        How to solve for the voxels at first. Once a term explains a disagreement of the views,
        the solve that is chosen anew is less smooth.
    unit : float
        Unit of the upstream emission.
    image_scale : (float, float), optional
        Unit of positions in the image, see `RayFeatures`.

    Notes
    -----
    Voxels imitate almost all of a dimming along rays: the images hardly change, the volume does.
    Training at fixed voxels would come near to it very slowly. These few numbers are therefore
    found by Gauss-Newton steps on the residual with the voxels eliminated
    (`tomo.wernet.default.linearisation`), summed over patches. Misfits count beyond the noise,
    which does not cancel within patches and which no term explains.

    Candidates are the views' gains and each of `TERMS`, or two terms together where none stands
    out alone. Each that promises to explain something is fitted. The best is kept as long as
    left-out views are predicted better with it, patch by patch
    (`tomo.wernet.default.patch_validation`). Gains have no priority: some three dozen numbers
    explain most of what one term does, and predict nothing for it.
    """
    stride = max(projector.shape[0] // (PIXELS_PER_UNKNOWN * max(projector.shape[1], 1)), 1)
    if not projector.rows_are_single_rays:
        stride = 1  # every pixel needs the rays of its neighbours
    subset = PixelSubset.of(projector, measured, stride, unit, image_scale)
    best, chosen = ViewParameters(projector.n_views, 1), ()
    now = subset.linearise(best, choice)
    residuals = left_out_patch_residuals(subset, subset.projector, choice)
    while promising := _promising(now, best, chosen):
        fits, before = [], _step(now, best, chosen).after or 1.0
        for terms in promising:
            parameters = copy.deepcopy(best)
            fitted = _fit(parameters, now, (*chosen, *terms))
            worth, beyond = WORTH_OF_GAINS, 0
            if GAINS not in terms:
                unexplained = _step(fitted, parameters, (*chosen, *terms)).after / before
                worth, beyond = min(WORTH_OF_A_TERM / (unexplained or 1.0), NO_WORSE), 1
            evaluated = _evaluate(fitted, now, residuals, worth, beyond)
            fits.append((*evaluated, terms, parameters, fitted))
        ratio, left, choice, terms, parameters, fitted = min(fits, key=lambda fit: fit[0])
        if not ratio < 1:
            break
        best, chosen, residuals = parameters, (*chosen, *terms), left
        now = fitted if choice is fitted.choice else subset.linearise(best, choice)
    return best if chosen else None


def _evaluate(
    fitted: Linearisation,
    now: Linearisation,
    others: NDArray[np.float64],
    worth: float,
    beyond: int,
) -> tuple[float, NDArray[np.float64], Choice]:
    """Return the residuals of left-out patches with a fit, and how to solve for them.

    The first value is their ratio to ``others``, those with the weights ``now``, over the ratio
    that is ``worth`` it, of the whole residual or ``beyond`` the noise. The solve is the one
    before or a new choice, whichever predicts patches better: the choice goes by pixels, which may
    ask for another smoothness. A fit is not to have all the credit for that: it must also predict
    patches better than the weights ``now`` do with the new choice.
    """
    subset, solves, before = fitted.subset, [], fitted.choice
    anew = choose_by_left_out_pixels(fitted.weighted, subset.measured)
    for choice in (before,) if anew.solves_as(before) else (before, anew):
        left = left_out_patch_residuals(subset, fitted.weighted, choice)
        ratio = _least_ratio(left[beyond], others[beyond]) / worth
        if choice is anew:
            same = left_out_patch_residuals(subset, now.weighted, anew)
            by_fit = _least_ratio(left[beyond], same[beyond])
            ratio = max(ratio, by_fit / max(worth, WORTH_OF_A_TERM))
        solves.append((ratio, left, choice))
    return min(solves, key=lambda solve: solve[0])


def _least_ratio(residuals: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return the least of the ratios of residuals to others."""
    return float(np.min(residuals / np.where(others, others, 1.0)))


def _promising(
    now: Linearisation, view_parameters: ViewParameters, chosen: Sequence[int]
) -> list[tuple[int, ...]]:
    """Return the terms and `GAINS` not yet chosen whose first step promises enough.

    They come one by one, or as pairs of terms where none alone does: each may hide the other.
    """
    candidates = {*range(len(TERMS)), GAINS}.difference(chosen)
    if now.subset.patches.pixels_per_patch < FINE:
        candidates.discard(VIGNETTING)
    chance = noise_along_a_term(dot(now.noise, now.noise), len(now.noise))

    def promises(*terms: int) -> bool:
        # Gains hide a term where they are not fitted with it, or take its effect where they are.
        for others in {tuple(chosen), tuple(sorted({*chosen, GAINS}.difference(terms)))}:
            without = _step(now, view_parameters, others).after
            coefficients, _, _, left = _step(now, view_parameters, (*others, *terms))
            # Light dims on its way. A brightening is an error of coarse voxels and pixels.
            dims = all(coefficients[term] < 0 for term in terms if term != GAINS)
            clear = GAINS in terms or without**2 - left**2 > len(terms) * chance
            if dims and clear and left < PROMISING[len(terms)] * without:
                return True
        return False

    alone = [(term,) for term in sorted(candidates) if promises(term)]
    pairs = itertools.combinations(sorted(candidates - {GAINS}), 2)
    return alone or [pair for pair in pairs if promises(*pair)]


def _fit(
    view_parameters: ViewParameters, now: Linearisation, terms: Sequence[int]
) -> Linearisation:
    """Fit ``terms`` in place, starting from ``now``; return the last linearisation."""
    subset, choice = now.subset, now.choice
    for _ in range(STEPS):
        coefficients, log_gains, before, after = _step(now, view_parameters, terms)
        if after > SETTLED * before:
            break
        with torch.no_grad():
            for k, change in coefficients.items():
                view_parameters.coefficients[k] = min(
                    float(view_parameters.coefficients[k]) + change, 0.0
                )
            log_gains = view_parameters.log_gain.numpy() + log_gains
            view_parameters.log_gain.copy_(
                torch.from_numpy((log_gains - log_gains.mean()).astype(np.float32))
            )
        now = subset.linearise(view_parameters, choice)
    return now


def _step(now: Linearisation, view_parameters: ViewParameters, terms: Sequence[int]) -> Step:
    """Return a step of ``terms``; the other coefficients and gains stay as they are."""
    numbers = [term for term in terms if term != GAINS]
    columns = [now.column(k) for k in numbers]
    gain_change = now.gain_change if GAINS in terms else np.zeros_like(now.gain_change)

    def fitted(misfit: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        step = _gauss_newton(columns, gain_change, now.view, misfit, len(view_parameters.log_gain))
        left = misfit - step[len(columns) :][now.view] * gain_change
        for column, change in zip(columns, step, strict=False):
            left = left - change * column
        return step, left

    step, left = fitted(now.residual)
    noise = fitted(now.noise)[1]
    changes = {k: float(c) / now.scale(k) for k, c in zip(numbers, step, strict=False)}
    before, after = (
        beyond_noise(dot(misfit, misfit), dot(noise, noise), len(noise))
        for misfit in (now.residual, left)
    )
    return Step(changes, step[len(columns) :], before, after)


def _gauss_newton(
    columns: Sequence[NDArray[np.float64]],
    gain_change: NDArray[np.float64],
    view: NDArray[np.integer],
    residual: NDArray[np.float64],
    views: int,
) -> NDArray[np.float64]:
    """Return the change of each coefficient, in units of its term, and of each log-gain.

    Arguments but the number of ``views`` have one number a patch, ``(patches,)``.
    """
    n = len(columns)
    normal, right = np.zeros((n + views, n + views)), np.zeros(n + views)
    gains = np.arange(n, n + views)
    normal[gains, gains] = np.bincount(view, gain_change * gain_change, views)
    right[n:] = np.bincount(view, gain_change * residual, views)
    for i, column in enumerate(columns):
        normal[i, n:] = normal[n:, i] = np.bincount(view, gain_change * column, views)
        right[i] = dot(column, residual)
        for j, other in enumerate(columns):
            normal[i, j] = dot(column, other)
    least = 1e-30 * float(normal.diagonal().max()) or 1.0  # a dark view leaves a row of zeros
    ridge = max(float(np.mean(residual**2)) / PRIOR**2, least)
    return np.linalg.solve(normal + ridge * np.eye(n + views), right)
