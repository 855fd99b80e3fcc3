"""Gains and global terms of a scene, found with the voxels eliminated."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.reductions import dot
from tomo.operators import VOXEL
from tomo.selection import Choice
from tomo.wernet.default.correction import ViewParameters
from tomo.wernet.default.left_out import Judged, LeftOut
from tomo.wernet.default.linearisation import Linearisation, PixelSubset
from tomo.wernet.default.patches import beyond_noise, noise_along_a_term
from tomo.wernet.default.ray_features import TERMS, RayFeatures

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

PROMISING = 0.975
"""Skip a candidate if its first Gauss-Newton step is predicted to leave more of the patch misfit
beyond noise. Larger: terms that are not there are fitted, in vain. Smaller: vignetting is missed.
"""


class Step(NamedTuple):
    """A Gauss-Newton step, and the patch misfit beyond noise before and after it.

    The noise counts less what terms and gains explain of it by chance.
    """

    coefficients: dict[int, float]
    log_gains: NDArray[np.float64]
    before: float
    after: float


def fit_parametric_terms(
    pixels: LeftOut,
    features: RayFeatures,
    choice: Choice,
    unit: float,
    lengths: Callable[[], Judged],
    candidates: Collection[int],
    *,
    volume: NDArray[np.float32] | None = None,
) -> tuple[ViewParameters | None, Judged | None]:
    """Return the gains and coefficients that predict left-out pixels best; None if none does.

    With them comes the solve by the best that was tried; None where nothing promised enough.

    Parameters
    ----------
    pixels : LeftOut
        The segments of its projector have midpoints.
    features : RayFeatures
        Of all its rays.
    choice : Choice
        How to solve for the voxels.
    unit : float
        Unit of the upstream emission.
    lengths : callable
        Returns the solve with segment lengths; called where a term promises something.
    candidates : collection of int
        Numbers of `TERMS`, and `GAINS` for the views' gains.
    volume : (unknowns,) float32, optional
        By segment lengths, to look for terms with; solved for when None.

    Notes
    -----
    Voxels imitate almost all of a dimming along rays: the images hardly change, the volume does.
    Training at fixed voxels would come near to it very slowly. These few numbers are therefore
    found by Gauss-Newton steps on the residual with the voxels eliminated
    (`tomo.wernet.default.linearisation`), summed over patches. Misfits count beyond the noise,
    which does not cancel within patches and which no term explains.

    Candidates are the views' gains and each of `TERMS`, or two terms together where none stands
    out alone. Each that promises to explain something is fitted without the left-out pixels. The
    one that predicts these best is kept if it does so better than without it by more than chance,
    and the others are then tried on top of it.
    """
    projector = pixels.projector.without_blur  # terms are of rays; a lens mixes these
    if pixels.projector.basis == VOXEL:
        projector = pixels.projector
    single = projector.rows_are_single_rays
    stride = max(projector.shape[0] // (PIXELS_PER_UNKNOWN * max(projector.shape[1], 1)), 1)
    # through a lens every pixel needs the rays of its neighbours
    held, stride = (pixels.held, stride) if single else (None, 1)
    scale = features.image_scale
    subset = PixelSubset.of(projector, pixels.measured, stride, unit, scale, held)
    best = ViewParameters(projector.n_views, 1)
    chosen: tuple[int, ...] = ()
    judged = tried = None
    now = subset.linearise(best, choice, volume)
    while promising := _promising(now, best, chosen, candidates):
        judged, fits = judged or lengths(), []
        for terms in promising:
            parameters = copy.deepcopy(best)
            # gains on top of terms leave these as they are: fitted together, both run away
            fitted = _fit(parameters, now, terms if GAINS in terms else (*chosen, *terms))
            found = pixels.judge_terms(features, parameters, choice, unit)
            fits.append((found, terms, parameters, fitted))
        found, terms, parameters, fitted = min(fits, key=lambda fit: fit[0].of_means.sum())
        tried = tried or found
        if not found.surely_better_than(judged):
            break
        best, chosen, judged, now = parameters, (*chosen, *terms), found, fitted
    return (best, judged) if chosen else (None, tried)


def _promising(
    now: Linearisation,
    view_parameters: ViewParameters,
    chosen: Sequence[int],
    candidates: Collection[int],
) -> list[tuple[int, ...]]:
    """Return the candidates not yet chosen whose first step promises enough.

    They come one by one, or as pairs of terms where none alone does: each may hide the other.
    """
    gains, candidates = {GAINS}.intersection(candidates), set(candidates).difference(chosen)
    if now.subset.patches.pixels_per_patch < FINE:
        candidates.discard(VIGNETTING)
    chance = noise_along_a_term(dot(now.noise, now.noise), len(now.noise))

    def promises(*terms: int) -> bool:
        # Gains hide a term where they are not fitted with it, or take its effect where they are.
        for others in {tuple(chosen), tuple(sorted(gains.union(chosen).difference(terms)))}:
            without = _step(now, view_parameters, others).after
            coefficients, _, _, left = _step(now, view_parameters, (*others, *terms))
            # Light dims on its way. A brightening is an error of coarse voxels and pixels.
            dims = all(coefficients[term] < 0 for term in terms if term != GAINS)
            clear = GAINS in terms or without**2 - left**2 > len(terms) * chance
            if dims and clear and left < PROMISING * without:
                return True
        return False

    alone: list[tuple[int, ...]] = [(term,) for term in sorted(candidates) if promises(term)]
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
    return np.asarray(np.linalg.solve(normal + ridge * np.eye(n + views), right), np.float64)
