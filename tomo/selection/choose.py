"""Smoothness and iterations, chosen by predicting left-out pixels.

A falling training residual does not mean a better volume: with few views, noise or inexact cameras
the volume gets worse long before. Every setting is therefore fitted without some blocks of pixels,
and compared by how well it predicts those.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured
from tomo.selection.fits import CHECKPOINTS, Fit, Fits, Progress, Tried
from tomo.selection.folds import (
    LEFT_OUT,
    Fold,
    blocks_to_leave_out,
    runs_of_pixels,
)
from tomo.selection.slab import part_to_choose_by
from tomo.selection.smooth_solve import smooth_start, solve_smoothly
from tomo.solvers import Solution
from tomo.solvers.solution import Callback

METHOD = "curvature"
"""The solver of the default, as reports name it."""

WIDTHS = (0.0, 0.6, 1.0, 1.6)
"""Standard deviations of the Gaussian basis that are tried, in voxels."""

STRENGTHS = tuple(10.0 ** (n / 2) for n in range(-10, 0))
"""Strengths of the prior that are tried: 1e-5 to 0.32 in steps of a half decade."""

FIRST = STRENGTHS.index(1e-3)
"""The strength that is tried first, at widths below one voxel. A wider basis is smooth by itself:
it gets `WEAKER`."""

WEAKER = 2
"""How many half decades weaker a prior a basis as wide as a voxel asks for."""

HOPELESS = 1.3
"""Residual of a width's first fits, as a multiple of the best, above which no other strength is
tried. A lower one gives up widths that would have won, a higher one costs fits."""

CLOSE, QUICK, FINALISTS = 1.02, 15, 4
"""All folds compare the best fits of each width whose residual is so many times the least at most,
and other fits that took so few iterations; no more than so many fits."""

TIE = 1.005
"""The widest basis is taken whose residual is so many times the least at most: left-out pixels,
which are noisy, tell widths less well than the truth does. A larger one blurs."""

PEAKED = STRENGTHS[2]
"""The strongest prior without a basis that makes light look peaked: `COUNTS` is tried too."""

COUNTS = 0.0
"""The strength that stands for no prior at all: `tomo.solvers.mlem` solves it."""

ENOUGH_BLOCKS, MOST_FOLDS = 400, 3
"""Left-out blocks that decide well enough: small images are left out in several folds, yet no
more than so many."""

DARK = (0.0, 1e-3, 10)
"""Width, strength and iterations for dark images, which predict nothing."""


@dataclass(frozen=True)
class Choice:
    """How to reconstruct, and why.

    Attributes
    ----------
    width : float
        Standard deviation of the Gaussian basis, in voxels; 0 for none.
    strength : float
        Strength of the prior on relative curvature, see `tomo.solvers.curvature`; 0 for none, with
        pixels as counts, see `tomo.solvers.mlem`.
    iterations : int
    held_out_residual : float
        Relative residual of the left-out pixels; NaN if none could be left out.
    reason : str
        Why, in words.
    tried : tuple of (width, strength, iterations, held-out residual)
        One line for each setting, at its best iteration.
    """

    width: float
    strength: float
    iterations: int
    held_out_residual: float
    reason: str = ""
    tried: tuple[Tried, ...] = ()

    @property
    def setting(self) -> Tried:
        """The choice without its reason."""
        return Tried(self.width, self.strength, self.iterations, self.held_out_residual)

    def solves_as(self, other: Choice) -> bool:
        """Return whether both solve the same way, whatever their validation errors."""
        ours, theirs = (one.setting._replace(held_out_residual=0.0) for one in (self, other))
        return ours == theirs

    @property
    def method(self) -> str:
        """The solver, as reports name it."""
        return METHOD if self.strength else "mlem"


def choose_by_left_out_pixels(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    blocks: NDArray[np.int64] | None = None,
    weights: NDArray[np.float32] | None = None,
    progress: Progress | None = None,
) -> Choice:
    """Choose width, strength and iterations by cross-validation over blocks of pixels.

    Parameters
    ----------
    projector : ProjectionOperator
        The operator of the views that take part.
    measured : (pixels,)
    blocks : (pixels,) int, optional
        The block of each pixel: pixels of a block are left out together, see
        `tomo.operators.LinearSystem.blocks`. Short rows of pixels when None.
    weights : (pixels,), optional
        Pixel weights for least squares and for evaluation, such as inverse variances of the
        noise; all 1 when None.
    progress : callable, optional
        ``progress(done, total, where)``.

    Notes
    -----
    The search goes from one width to the next while the error of one fold's left-out pixels falls,
    and at each width from one strength to the next likewise. All folds compare the last
    candidates, and the widest basis is taken that predicts as well as the best. Where none is
    asked for, pixels as photon counts are a candidate too: light in peaks as narrow as voxels.
    """
    measured = check_measured(projector, measured)
    if not measured.any():
        return Choice(*DARK, math.nan, reason="the images are dark")
    fits = _fits(projector, measured, blocks, weights, progress)
    _search(fits)
    best, residual = _final(fits)
    if progress:
        progress(fits.total, fits.total, "")
    reason = f"it predicts left-out pixels best (relative residual {residual:.4f})"
    return Choice(best.width, best.strength, best.iterations, residual, reason, fits.tried)


def left_out_residual(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    blocks: NDArray[np.int64] | None = None,
    weights: NDArray[np.float32] | None = None,
) -> float:
    """Return the relative residual of left-out pixels at a choice's width and strength.

    Arguments as of `choose_by_left_out_pixels`.
    """
    fits = _fits(projector, check_measured(projector, measured), blocks, weights, None)
    found = fits.to_all_folds(fits.at(choice.width, choice.strength, CHECKPOINTS[-1]))
    return fits.residual(found, len(fits.folds))


def _fits(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    blocks: NDArray[np.int64] | None,
    weights: NDArray[np.float32] | None,
    progress: Progress | None,
) -> Fits:
    """Return the folds of all pixels, or of a slab of a large volume."""
    blocks = runs_of_pixels(projector) if blocks is None else blocks
    part = part_to_choose_by(projector, measured)
    if part is not None:
        projector, measured, blocks = part.projector, part.measured, blocks[part.pixels]
        weights = None if weights is None else weights[part.pixels]
    return Fits(_folds(projector, measured, blocks, weights), progress, total=12)


def _folds(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    blocks: NDArray[np.int64],
    weights: NDArray[np.float32] | None,
) -> list[Fold]:
    """Return as many folds as leave out enough blocks of pixels that see a voxel."""
    seen = projector.row_sums > 0
    a_fold = LEFT_OUT * len(np.unique(blocks[seen]))
    count = min(max(math.ceil(ENOUGH_BLOCKS / max(a_fold, 1)), 1), MOST_FOLDS)
    held = (blocks_to_leave_out(blocks, number) & seen for number in range(count))
    return [
        Fold.leaving_out(each, projector, measured, weights, blocks)
        for each in held
        if each.any() and not each.all()
    ]


def _search(fits: Fits) -> None:
    """Fit the first fold by one setting after the other while the best improves."""
    for width, weaker in ((0.6, 0), (1.0, WEAKER), (0.0, 0)):
        fits.at(width, STRENGTHS[FIRST - weaker])
    best = _of_width(fits, fits.best, (-1, 1))
    for step in (1, -1):
        at = WIDTHS.index(best.width) + step
        while 0 <= at < len(WIDTHS):
            # wider blobs are smooth by themselves and ask for a weaker prior, narrower ones not
            number = STRENGTHS.index(best.strength) - step
            fits.at(WIDTHS[at], STRENGTHS[min(max(number, 0), len(STRENGTHS) - 1)])
            begin = fits.of_width(WIDTHS[at])
            assert begin is not None
            if begin.error > HOPELESS**2 * best.error:
                break
            found = _of_width(fits, begin, (-step, step))
            if found.error >= best.error:
                break
            best, at = found, at + step


def _of_width(fits: Fits, best: Fit, steps: Sequence[int]) -> Fit:
    """Return the best fit of a width, from one strength to the next while it improves.

    ``steps`` are the directions to go in, the second only where the first improves nothing.
    """
    begun = best
    for step in steps:
        at = STRENGTHS.index(best.strength) + step
        while 0 <= at < len(STRENGTHS):
            found = fits.at(best.width, STRENGTHS[at])
            if found.error >= best.error:
                break
            best, at = found, at + step
        if best is not begun:
            break
    return best


def _final(fits: Fits) -> tuple[Fit, float]:
    """Return the best of the last candidates by all folds, and its relative residual."""
    order = sorted(fits.done.values(), key=lambda fit: fit.error)
    close = [fit for fit in order if fit.error <= CLOSE**2 * order[0].error]
    widths = {fit.width: fit for fit in reversed(close)}
    others = [fit for fit in close if fit is not widths[fit.width] and fit.iterations <= QUICK]
    rivals, folds = [*widths.values(), *others][:FINALISTS], 1
    if len(rivals) > 1:
        rivals, folds = [fits.to_all_folds(fit) for fit in rivals], len(fits.folds)
    least = min(fit.error for fit in rivals)
    ties = [fit for fit in rivals if fit.error <= TIE**2 * least]
    best = max(ties, key=lambda fit: (fit.width, -fit.error))
    while folds > 1 and best.iterations <= QUICK and best.strength < STRENGTHS[-1]:
        stronger = STRENGTHS[STRENGTHS.index(best.strength) + 1]
        found = fits.to_all_folds(fits.at(best.width, stronger))
        if found.error >= best.error:
            break
        best = found
    residual = fits.residual(best, folds)
    ended = fits.to_the_end(best.width, best.strength)
    if best.width == 0 and best.strength <= PEAKED:
        counted = fits.to_the_end(0.0, COUNTS)
        if counted.error <= CLOSE**2 * ended.error:
            ended, counted = fits.to_all_folds(ended), fits.to_all_folds(counted)
            ended = min(counted, ended, key=lambda fit: fit.error)
            residual = fits.residual(ended, len(fits.folds))
    return ended, residual


def solve_as_chosen(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    weights: NDArray[np.float32] | None = None,
    start: NDArray[np.float32] | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Solve all pixels as chosen, with the ``weights`` that it was chosen with.

    ``start`` is a volume like that of `smooth_start`, which is found where None is given.
    ``callback`` receives the volume itself, not the coefficients of the smooth basis.
    """
    measured = check_measured(projector, measured)
    found = solve_smoothly(
        projector,
        measured,
        width=choice.width,
        strength=choice.strength,
        iterations=choice.iterations,
        start=smooth_start(projector, measured) if start is None else start,
        weights=weights,
        callback=callback,
    )
    words = f"; {choice.reason}" if choice.reason else ""
    return replace(found, stop_reason=f"{found.stop_reason}{words}")
