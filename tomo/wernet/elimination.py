"""A first guess of what weights a scene needs: few numbers, with the voxels eliminated."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._sums import dot
from tomo.solve.stopping import Choice, choose_by_held_out_views
from tomo.wernet._left_out import residuals_of_left_out_patches
from tomo.wernet._linearised import Linearised, Thinned
from tomo.wernet.correction import ViewTokens
from tomo.wernet.ray_features import TRENDS

if TYPE_CHECKING:
    from tomo.projector import Projector

STEPS = 3
PIXELS_AN_UNKNOWN = 3
PRIOR = 0.3
"""Standard deviation of the correction that one number may make, before the images are asked."""

SETTLED = 0.99
"""Steps end when the next would leave more than this share of the patches' misfit."""

PROMISING = 0.95
"""A trend whose first step would leave more than this share of the patches' misfit is not tried.
Of 11 scenes it left at most 0.87 where the trend was then worth it, and at least 0.97 where voxels
and single rays were all that the chords lacked."""

WORTH = 0.85
"""Levels, and then each trend, must lower the residual of left-out views, summed over patches, to
this share of that without them, each solved as suits it best. A trend imitates what voxels and
single rays leave out to 0.94 of it; levels make 0.86 of noise alone, by chance, with a dozen
views."""


def first_guess(
    projector: Projector, measured: NDArray[np.float32], choice: Choice, unit: float
) -> ViewTokens | None:
    """Return levels of the views and trends along the rays that predict left-out views best.

    What dims along a ray, by depth or by the emission in front, the voxels imitate almost: the
    images hardly change, the volume does. Steps of the encoder at fixed voxels see none of that
    and come near very slowly. These few numbers are therefore found with the voxels eliminated:
    Gauss-Newton steps on the residual of `tomo.wernet._linearised`, summed over patches. Trends
    are added one by one, of those whose first step promises to explain something, as long as
    left-out views are predicted better, patch by patch (`tomo.wernet._left_out`). None where
    neither levels nor a trend do that.

    Parameters
    ----------
    projector : Projector
        Of chord lengths, with midpoints.
    measured : (pixels,) float32
    choice : Choice
        How to solve for the voxels.
    unit : float
        Of the emission in front.
    """
    stride = max(projector.shape[0] // (PIXELS_AN_UNKNOWN * max(projector.shape[1], 1)), 1)
    some = Thinned.of(projector, measured, stride, unit)
    best, chosen = ViewTokens(projector.n_views, 1), ()
    now = _fit(best, some, choice, chosen)
    chords = residuals_of_left_out_patches(some, some.projector, choice)
    # What still disagrees asks for more smoothness than what is left once it is explained.
    choice, residuals = _judged(now)
    worth = _share(residuals, chords) < WORTH
    while promising := _promising(now, best, chosen):
        trials = []
        for trend in promising:
            tokens = copy.deepcopy(best)
            fitted = _fit(tokens, some, choice, (*chosen, trend))
            if tokens.trend[trend] < best.trend[trend]:
                found, left = _judged(fitted)
                trials.append((_share(left, residuals), found, left, trend, tokens, fitted))
        share, *last = min(trials, key=lambda trial: trial[0], default=(math.inf,))
        if not share < WORTH:
            break
        choice, residuals, trend, best, now = last
        chosen, worth = (*chosen, trend), True
    return best if worth else None


def _judged(fitted: Linearised) -> tuple[Choice, NDArray[np.float64]]:
    """Return how to solve with weights found, and the residuals of left-out patches then."""
    some = fitted.some
    choice = choose_by_held_out_views(fitted.learned, some.measured)
    return choice, residuals_of_left_out_patches(some, fitted.learned, choice)


def _share(residuals: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return to what share of the others residuals fall where they fall most."""
    return float(np.min(residuals / np.where(others, others, 1.0)))


def _promising(now: Linearised, tokens: ViewTokens, chosen: Sequence[int]) -> list[int]:
    """Return the trends not yet chosen that the patches' residuals ask for."""
    _, without = _step(now, tokens, chosen)
    promising = []
    for trend in sorted(set(range(len(TRENDS))) - set(chosen)):
        step, left = _step(now, tokens, (*chosen, trend))
        if step[len(chosen)] < 0 and left < PROMISING * without:
            promising.append(trend)
    return promising


def _fit(tokens: ViewTokens, some: Thinned, choice: Choice, trends: Sequence[int]) -> Linearised:
    """Fit levels and ``trends`` to the images, in place; return how things are then."""
    now = some.at(tokens, choice)
    for _ in range(STEPS):
        step, left = _step(now, tokens, trends)
        if left > SETTLED:
            break
        with torch.no_grad():
            for k, change in zip(trends, step, strict=False):
                # Light dims on its way: brightening is what coarse voxels and pixels look like.
                tokens.trend[k] = min(float(tokens.trend[k]) + float(change), 0.0)
            levels = tokens.level.numpy() + step[len(trends) :]
            tokens.level.copy_(torch.from_numpy((levels - levels.mean()).astype(np.float32)))
        now = some.at(tokens, choice)
    return now


def _step(
    now: Linearised, tokens: ViewTokens, trends: Sequence[int]
) -> tuple[NDArray[np.float64], float]:
    """Return the change of ``trends`` and levels, and the share of the misfit that it leaves."""
    rows = [now.row(k) for k in trends]
    step = _gauss_newton(rows, now.level, now.view, now.residual, tokens)
    left = now.residual - step[len(rows) :][now.view] * now.level
    for row, change in zip(rows, step, strict=False):
        left = left - change * row
    step[: len(rows)] /= [now.scale(k) for k in trends]
    return step, math.sqrt(dot(left, left) / (dot(now.residual, now.residual) or 1.0))


def _gauss_newton(
    rows: Sequence[NDArray[np.float64]],
    level: NDArray[np.float64],
    view: NDArray[np.integer],
    residual: NDArray[np.float64],
    tokens: ViewTokens,
) -> NDArray[np.float64]:
    """Return the change of each trend, in units of its column's size, and of each level.

    All but the tokens have one number a patch, ``(patches,)``.
    """
    n, views = len(rows), len(tokens.level)
    normal, right = np.zeros((n + views, n + views)), np.zeros(n + views)
    places = np.arange(n, n + views)
    normal[places, places] = np.bincount(view, level * level, views)
    right[n:] = np.bincount(view, level * residual, views)
    for i, row in enumerate(rows):
        normal[i, n:] = normal[n:, i] = np.bincount(view, level * row, views)
        right[i] = dot(row, residual)
        for j, other in enumerate(rows):
            normal[i, j] = dot(row, other)
    least = 1e-30 * float(normal.diagonal().max()) or 1.0  # dark views leave rows of nothing
    ridge = max(float(np.mean(residual**2)) / PRIOR**2, least)
    return np.linalg.solve(normal + ridge * np.eye(n + views), right)
