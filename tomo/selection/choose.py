"""Smoothness and iterations, chosen by predicting left-out pixels.

A falling training residual does not mean a better volume: with few views, noise or inexact cameras
the volume gets worse long before. Every setting is therefore fitted without some blocks of pixels,
and compared by how well it predicts those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import host
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured
from tomo.selection.fits import Fit, Fits, Progress, Tried
from tomo.selection.folds import (
    LEFT_OUT,
    Fold,
    blocks_to_leave_out,
    part_to_choose_by,
    runs_of_pixels,
)
from tomo.selection.smooth_solve import smooth_start, solve_smoothly
from tomo.solvers import Solution
from tomo.solvers.solution import Callback

METHOD = "curvature"
"""The solver of the default, as reports name it."""

WIDTHS = (0.0, 0.6, 1.0, 1.6)
"""Standard deviations of the Gaussian basis that are tried, in voxels."""

STRENGTHS = (0.0, *(10.0**n for n in (-4.5, -3.5, -2.5, -1.5, -0.5)))
"""Strengths of the prior that are tried. Finer steps cost fits and choose no better. Zero, on
voxels alone, is `tomo.solvers.mlem`: light in peaks as narrow as voxels."""

FIRST = 1, 2
"""The width and the strength that are tried first, by their numbers."""

MOVES = (1, -1), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, 1)
"""Where a better setting is looked for, in numbers of width and strength: a wider basis is smooth
by itself and asks for a weaker prior. The first that is better is taken."""

ENOUGH_BLOCKS, MOST_FOLDS = 400, 2
"""Left-out blocks that decide well enough: small images are left out in several folds, yet no
more than so many."""

DARK = (0.0, 1e-3, 10)
"""Width, strength and iterations for dark images, which predict nothing."""


@dataclass(frozen=True)
class Choice:
    """How to reconstruct, and why."""

    width: float  # standard deviation of the Gaussian basis, in voxels; 0 for none
    strength: float  # of `tomo.solvers.curvature`; 0: pixels as counts, `tomo.solvers.mlem`
    iterations: int
    held_out_residual: float  # relative, of left-out pixels; NaN if none could be left out
    reason: str = ""  # why, in words
    tried: tuple[Tried, ...] = ()  # each setting at its best iteration

    @property
    def method(self) -> str:
        """The solver, as reports name it."""
        return METHOD if self.strength else "mlem"

    @property
    def setting(self) -> Tried:
        """The choice without its reason."""
        return Tried(self.width, self.strength, self.iterations, self.held_out_residual)


def choose_by_left_out_pixels(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    blocks: NDArray[np.int64] | None = None,
    weights: NDArray[np.float32] | None = None,
    progress: Progress | None = None,
) -> Choice:
    """Choose width, strength and iterations by cross-validation over blocks of pixels.

    One in eight blocks is left out, of all pixels or of a slab of a large volume. The search goes
    from setting to neighbouring setting (`MOVES`) while the error of the left-out pixels falls.
    The setting of the least error is taken: the smoothest within one standard error of it
    (Breiman, Friedman, Stone and Olshen, "Classification and Regression Trees", 1984, section
    3.4.3) was worse on noisy scenes, by 24 % at most and 1 % on average.

    ``blocks`` (pixels,) int are each pixel's, see `tomo.operators.LinearSystem.blocks`; short rows
    of pixels when None. ``weights`` (pixels,), such as inverse variances, are for least squares
    and for evaluation.
    """
    measured = host(check_measured(projector, measured))
    if not measured.any():
        return Choice(*DARK, math.nan, reason="the images are dark")
    fits = Fits(_folds(projector, measured, blocks, weights), progress)
    best = _least_error(fits)
    if progress:
        progress(fits.total, fits.total, "")
    residual = fits.residual(best)
    reason = f"it predicts left-out pixels best (relative residual {residual:.4f})"
    return Choice(best.width, best.strength, best.iterations, residual, reason, fits.tried)


def _folds(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    blocks: NDArray[np.int64] | None,
    weights: NDArray[np.float32] | None,
) -> list[Fold]:
    """Return the folds that leave out enough blocks, of all pixels or of a slab."""
    blocks = runs_of_pixels(projector) if blocks is None else blocks
    part = part_to_choose_by(projector, measured)
    if part is not None:
        projector, measured, blocks = part.projector, part.measured, blocks[part.pixels]
        weights = None if weights is None else weights[part.pixels]
    seen = projector.row_sums > 0
    a_fold = LEFT_OUT * len(np.unique(blocks[seen]))
    count = min(max(math.ceil(ENOUGH_BLOCKS / max(a_fold, 1)), 1), MOST_FOLDS)
    held = (blocks_to_leave_out(blocks, number) & seen for number in range(count))
    return [
        Fold.leaving_out(each, projector, measured, weights, blocks)
        for each in held
        if each.any() and not each.all()
    ]


def _least_error(fits: Fits) -> Fit:
    """Return the setting of the least error that steps to better neighbours lead to."""
    at, best = FIRST, fits.at(WIDTHS[FIRST[0]], STRENGTHS[FIRST[1]])
    seen, better = {at}, True
    while better:
        better = False
        for move in MOVES:
            there = at[0] + move[0], at[1] + move[1]
            inside = 0 <= there[0] < len(WIDTHS) and (there[0] > 0) <= there[1] < len(STRENGTHS)
            if not inside or there in seen:
                continue
            seen.add(there)
            found = fits.at(WIDTHS[there[0]], STRENGTHS[there[1]])
            if found.error < best.error:
                at, best, better = there, found, True
                break
    return best


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
