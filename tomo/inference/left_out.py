"""Left-out pixels: corrections are kept that predict them better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tomo.inference import misplaced
from tomo.inference.fit import Fit
from tomo.inference.solve import fitted_from_even
from tomo.inference.steps import Null
from tomo.measurement.noise_model import SIDE
from tomo.selection.folds import blocks_to_leave_out

FOLDS = 2
"""Eighths of the squares that are predicted, each from the rest. Fewer leave more to chance; more
take longer."""

NEGLIGIBLE = 0.005
"""Fraction of the squares that a correction has to explain beside chance. Less, the many views of
a flame finer than voxels are corrected for nothing; more, faults of one view of many stay."""

ONE_SIDED = 0.07
"""Smaller of the squares of what is too bright and too dark in a view, over both, below which
something shines into it or hides a part. Larger, other moments count as that; smaller, hardware
before a view counts as another flame."""

COMPARED = 8
"""Views that a doubtful one is compared with. With fewer, chance decides; more take longer."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """How fits predict pixels that were left out of them, before a correction and after it.

    Both are squared errors (squares,) over the images' mean square, summed over each square
    and all frames.
    """

    before: NDArray[np.float64]
    after: NDArray[np.float64]
    pixels: int = 1

    @property
    def relative_errors(self) -> tuple[float, float]:
        """Root mean square errors over that of the images, before the correction and after it."""
        before, after = (math.sqrt(one.sum() / self.pixels) for one in (self.before, self.after))
        return before, after

    @property
    def is_better(self) -> bool:
        """Whether the correction predicts them better at all: enough where it was asked for."""
        return bool(self.after.sum() < self.before.sum())

    @property
    def score(self) -> float:
        """By how many standard errors of the squares' differences the correction is better."""
        less = self.before - self.after
        chance = math.sqrt(len(less)) * less.std() if len(less) else 0.0
        spread = math.hypot(chance, NEGLIGIBLE * self.before.sum())
        return float(less.sum() / spread) if spread > 0 else 0.0

    @property
    def is_clearly_better(self) -> bool:
        """Whether it predicts better by more than a standard error: what was not asked for has to.

        The rule of `tomo.selection.folds.surely_lower`.
        """
        return self.score > 1


class Predicting(Protocol):
    """Fits of some frames, and how they predict the pixels that are left out of them."""

    @property
    def fits(self) -> Sequence[Fit]:
        """One a frame."""

    @property
    def left_out_errors(self) -> NDArray[np.float64]:
        """See `squared_errors`."""


def predict_left_out(given: Predicting, corrected: Predicting) -> LeftOut:
    """Return how states of the same frames predict left-out pixels; those count that both use."""
    squares = _squares(given.fits)
    used = np.all([one.usable for one in (*given.fits, *corrected.fits)], axis=0)
    both = _left_out(squares) & used
    block = np.unique(squares[both], return_inverse=True)[1]
    before, after = (one.left_out_errors[both] for one in (given, corrected))
    before, after = (np.bincount(block, own).astype(np.float64) for own in (before, after))
    return LeftOut(before, after, max(len(block), 1))


def without_left_out(fits: Sequence[Fit]) -> tuple[Fit, ...]:
    """Return fits that do not use the pixels that are left out."""
    out = _left_out(_squares(fits))
    return tuple(
        replace(one, usable=one.usable & ~out, trust=np.where(out, 0.0, one.trust)) for one in fits
    )


def _left_out(squares: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which pixels are left out once, ``(pixels,)``."""
    return np.any([blocks_to_leave_out(squares, number) for number in range(FOLDS)], axis=0)


def _squares(fits: Sequence[Fit]) -> NDArray[np.intp]:
    """Return the square of each pixel: of single ones, neighbours would predict the most."""
    return fits[0].system.squares([SIDE] * len(fits[0].observation.rig))


def squared_errors(fits: Sequence[Fit]) -> NDArray[np.float64]:
    """Return the squared errors of left-out pixels, ``(pixels,)``, over the images' mean square.

    Each is predicted from all pixels but its fold's. Usable pixels count alike, as in the solve
    that the effects are found for.
    """
    errors, squares = np.zeros(len(fits[0].measured)), _squares(fits)
    for number in range(FOLDS):
        out = blocks_to_leave_out(squares, number)
        for fit in fits:
            errors[out] += np.square(
                fitted_from_even(replace(fit, usable=fit.usable & ~out)).residual[out]
            )
    return errors / (sum(float(np.mean(np.square(fit.measured))) for fit in fits) or 1.0)


def contradicts(
    fits: Sequence[Fit], null: Null | None, view: int, others: NDArray[np.bool_]
) -> bool:
    """Return whether a view shows another flame than the others.

    It is predicted far worse than most others are, and is both too bright and too dark: what
    shines into a view only adds light to it, and what hides a part only takes some.

    Parameters
    ----------
    null : Null, optional
        Scenes like this one as exact cameras see them: what these miss, no other view shows.
    others : (views,) bool
        Those to compare with, of which up to `COMPARED` are. Each is predicted without the view,
        and without itself.
    """
    some = np.flatnonzero(others)
    some = some[np.linspace(0, len(some) - 1, min(COMPARED, len(some))).round().astype(int)]
    too_bright, too_dark = _squares_of_prediction(fits, view, [view])
    error = too_bright + too_dark
    if len(some) < 2 or min(too_bright, too_dark) < ONE_SIDED * error:
        return False
    if null is not None:
        error -= null.factor**2 * sum(_squares_of_prediction(null.fits, view, [view]))
    left = len(some) // 4  # of the views that may be predicted nearly as badly
    for one in some:
        left -= sum(_squares_of_prediction(fits, one, [view, one])) >= misplaced.BETTER * error
        if left < 0:
            return False
    return True


def _squares_of_prediction(
    fits: Sequence[Fit], view: int, without: list[int]
) -> tuple[float, float]:
    """Return the squares of what is too bright and too dark in a view, over its own square.

    Its prediction is of a volume without some views.
    """
    own = slice(*fits[0].system.projector.view_ptr[view : view + 2])
    kept = np.ones(len(fits[0].observation.rig), bool)
    kept[without] = False
    bright = dark = energy = 0.0
    for fit in fits:
        left = fitted_from_even(fit.of_views(kept)).residual[own]
        bright += float(np.square(np.maximum(left, 0)).sum())
        dark += float(np.square(np.maximum(-left, 0)).sum())
        energy += float(np.square(fit.measured[own]).sum())
    return bright / max(energy, 1e-300), dark / max(energy, 1e-300)
