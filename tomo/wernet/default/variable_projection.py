"""A first guess of what weights a scene needs: few numbers, with the voxels eliminated."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.reductions import dot
from tomo.selection import Choice, choose_by_held_out_views
from tomo.wernet.default.correction import ViewTokens
from tomo.wernet.default.linearised import Linearised, Thinned
from tomo.wernet.default.patch_noise import beyond_noise, chance_of_a_trend
from tomo.wernet.default.patch_validation import residuals_of_left_out_patches
from tomo.wernet.default.ray_features import TRENDS

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator

STEPS = 6
PIXELS_AN_UNKNOWN = 12
PRIOR = 0.3
"""Standard deviation of the correction that one number may make, before the images are asked."""

SETTLED = 0.995
"""Steps end when the next would leave more than this share of the patches' misfit."""

OFF_AXIS = len(TRENDS) - 1
FINE = 16
"""Pixels a patch. A lens that darkens is sought among finer ones alone: voxels imitate all but a
three hundredth of it, and pixels as coarse as voxels look like it."""

LEVELS = len(TRENDS)
"""The levels of the views, beside the numbers of the trends, as what may be looked for."""

PROMISING = {1: 0.975, 2: 0.92}
"""What would, by its first step, leave more than this share of the patches' misfit is not tried:
a part alone, or two trends. A lens that takes 40 % from the corners leaves 0.955 to 0.970 on a jet
of 33 views, and the trend of one that does not 0.998. With gains, defocus and all else at once a
jet's own absorption leaves 0.96, as does its lens, but both together leave 0.91; of two trends
that are not there 0.966. Eleven views once left 0.93, of two 0.924: left-out views have to
agree."""

WORTH_OF_LEVELS, WORTH_OF_TRENDS = 0.85, 0.94
"""What is kept must lower the residual of left-out views, summed over patches, to this share.
Levels are many: they make 0.86 of noise alone, by chance, with a dozen views. A trend is one
number: what it explains of all views counts as well, and the product of both shares must be as
low. Left-out views alone see little of some: a lens that darkens explains 0.6 of what is left of
the turbulent flame's images, and of left-out views, where other things err more, 0.02."""

NO_WORSE = 1.05
"""By so much, at most, a trend may predict left-out views worse, if it explains enough of all. A
jet's own absorption beside all else, found as it is, makes 1.02 to 1.04, in clean images as well;
what the volume errs by for want of views changes by that much."""


class Step(NamedTuple):
    """What a step changes; what of the patches' misfit is known beyond noise, before and after.

    Of the noise less than all: what trends and levels explain of that by chance they have.
    """

    trends: dict[int, float]
    levels: NDArray[np.float64]
    before: float
    after: float


def first_guess(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    choice: Choice,
    unit: float,
    widest: tuple[float, float] | None = None,
) -> ViewTokens | None:
    """Return levels of the views and trends along the rays that predict left-out views best.

    What dims along a ray, by depth or by the emission in front, the voxels imitate almost: the
    images hardly change, the volume does. Steps of the encoder at fixed voxels see none of that
    and come near very slowly. These few numbers are therefore found with the voxels eliminated:
    Gauss-Newton steps on the residual of `tomo.wernet.default.linearised`, summed over patches.
    Shares of misfits are of what is known of them beyond noise
    (`tomo.wernet.default.patch_noise`): it does not cancel within patches, rules the misfit of 2 %
    noisy images, and is explained by nothing. Levels and trends are added one by one, or two
    trends at once where neither stands out alone, of those whose first step promises to explain
    something, as long as left-out views, patch by patch (`tomo.wernet.default.patch_validation`),
    speak for it. Levels have no right of way: some three dozen numbers take most of what one trend
    explains, and predict nothing for it. None where nothing is worth it.

    Parameters
    ----------
    projector : ProjectionOperator
        Of chord lengths, with midpoints.
    measured : (pixels,) float32
    choice : Choice
        How to solve for the voxels at first: what still disagrees asks for more smoothness than
        what is left once it is explained.
    unit : float
        Of the emission in front.
    widest : (float, float), optional
        In which places in the image are counted, see `RayFeatures`.
    """
    stride = max(projector.shape[0] // (PIXELS_AN_UNKNOWN * max(projector.shape[1], 1)), 1)
    if not projector.rows_are_single_rays:
        stride = 1  # every pixel needs the rays of its neighbours
    some = Thinned.of(projector, measured, stride, unit, widest)
    best, chosen = ViewTokens(projector.n_views, 1), ()
    now = some.at(best, choice)
    residuals = residuals_of_left_out_patches(some, some.projector, choice)
    while promising := _promising(now, best, chosen):
        trials, before = [], _step(now, best, chosen).after or 1.0
        for parts in promising:
            tokens = copy.deepcopy(best)
            fitted = _fit(tokens, now, (*chosen, *parts))
            worth, beyond = WORTH_OF_LEVELS, 0
            if LEVELS not in parts:
                unexplained = _step(fitted, tokens, (*chosen, *parts)).after / before
                worth, beyond = min(WORTH_OF_TRENDS / (unexplained or 1.0), NO_WORSE), 1
            trials.append((*_judged(fitted, residuals, worth, beyond), parts, tokens, fitted))
        share, left, choice, parts, tokens, fitted = min(trials, key=lambda trial: trial[0])
        if not share < 1:
            break
        best, chosen, residuals = tokens, (*chosen, *parts), left
        now = fitted if choice is fitted.choice else some.at(best, choice)
    return best if chosen else None


def _judged(
    fitted: Linearised, others: NDArray[np.float64], worth: float, beyond: int
) -> tuple[float, NDArray[np.float64], Choice]:
    """Return the residuals of left-out patches with what was fitted, and how to solve for them.

    Before them, their share of ``others`` over that which is worth it, as they are or ``beyond``
    the noise. Solved as before or as suits what was fitted, whichever predicts patches better:
    pixels, by which the latter is chosen, may ask for another smoothness than patches.
    """
    some, trials, before = fitted.some, [], fitted.choice
    anew = choose_by_held_out_views(fitted.learned, some.measured)
    for choice in (before,) if anew.solves_as(before) else (before, anew):
        left = residuals_of_left_out_patches(some, fitted.learned, choice)
        trials.append((_share(left[beyond], others[beyond]) / worth, left, choice))
    return min(trials, key=lambda trial: trial[0])


def _share(residuals: NDArray[np.float64], others: NDArray[np.float64]) -> float:
    """Return to what share of the others residuals fall where they fall most."""
    return float(np.min(residuals / np.where(others, others, 1.0)))


def _promising(
    now: Linearised, tokens: ViewTokens, chosen: Sequence[int]
) -> list[tuple[int, ...]]:
    """Return the trends, and `LEVELS`, not yet chosen that the patches' residuals ask for.

    One each, or pairs of trends where none alone is asked for: each may hide the other.
    """
    parts = {*range(len(TRENDS)), LEVELS}.difference(chosen)
    if now.some.patches.pixels_each < FINE:
        parts.discard(OFF_AXIS)
    chance = chance_of_a_trend(dot(now.noise, now.noise), len(now.noise))

    def asked_for(*some: int) -> bool:
        # Gains hide a trend where levels are not fitted beside it, or take it where they are.
        for others in {tuple(chosen), tuple(sorted({*chosen, LEVELS}.difference(some)))}:
            without = _step(now, tokens, others).after
            trends, _, _, left = _step(now, tokens, (*others, *some))
            # Light dims on its way: brightening is what coarse voxels and pixels look like.
            dims = all(trends[part] < 0 for part in some if part != LEVELS)
            clear = LEVELS in some or without**2 - left**2 > len(some) * chance
            if dims and clear and left < PROMISING[len(some)] * without:
                return True
        return False

    alone = [(part,) for part in sorted(parts) if asked_for(part)]
    pairs = itertools.combinations(sorted(parts - {LEVELS}), 2)
    return alone or [pair for pair in pairs if asked_for(*pair)]


def _fit(tokens: ViewTokens, now: Linearised, parts: Sequence[int]) -> Linearised:
    """Fit ``parts`` of the tokens to the images, in place, from ``now``; return how things are."""
    some, choice = now.some, now.choice
    for _ in range(STEPS):
        trends, levels, before, after = _step(now, tokens, parts)
        if after > SETTLED * before:
            break
        with torch.no_grad():
            for k, change in trends.items():
                tokens.trend[k] = min(float(tokens.trend[k]) + change, 0.0)
            levels = tokens.level.numpy() + levels
            tokens.level.copy_(torch.from_numpy((levels - levels.mean()).astype(np.float32)))
        now = some.at(tokens, choice)
    return now


def _step(now: Linearised, tokens: ViewTokens, parts: Sequence[int]) -> Step:
    """Return a step of ``parts``; other trends and levels stay as they are."""
    trends = [part for part in parts if part != LEVELS]
    rows = [now.row(k) for k in trends]
    level = now.level if LEVELS in parts else np.zeros_like(now.level)

    def fitted(misfit: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        step = _gauss_newton(rows, level, now.view, misfit, tokens)
        left = misfit - step[len(rows) :][now.view] * level
        for row, change in zip(rows, step, strict=False):
            left = left - change * row
        return step, left

    step, left = fitted(now.residual)
    noise = fitted(now.noise)[1]
    changes = {k: float(c) / now.scale(k) for k, c in zip(trends, step, strict=False)}
    before, after = (
        beyond_noise(dot(misfit, misfit), dot(noise, noise), len(noise))
        for misfit in (now.residual, left)
    )
    return Step(changes, step[len(rows) :], before, after)


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
