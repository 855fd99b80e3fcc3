"""Left-out pixels: corrections are kept that predict them better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tomo.inference.fit import Fit
from tomo.inference.solve import next_fit
from tomo.measurement.noise_model import SIDE
from tomo.selection.folds import blocks_to_leave_out

BETTER = 0.5
"""Standard errors of the squares' differences by which a correction predicts better. Less, poses
that voxels made of turbulence are kept; more, real ones of cameras that all err are lost."""

WORSE = 2.0
"""The same, by which an effect that is let loose predicts worse: it is not taken. Less, hidden
pixels are not found, which gains make good; more, gains are taken that stand for hidden pixels."""


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
        spread = math.sqrt(len(less)) * less.std() if len(less) else 0.0
        return float(less.sum() / spread) if spread > 0 else 0.0

    @property
    def is_clearly_better(self) -> bool:
        """Whether it predicts better by more than `BETTER`: what was not asked for has to."""
        return self.score > BETTER

    @property
    def misleads(self) -> bool:
        """Whether it predicts worse by more than `WORSE`."""
        return self.score < -WORSE

    def is_worth(self, data: float) -> bool:
        """Return whether it is clearly better than a fraction ``data`` of the data less makes it.

        Fewer data are easier to reproduce, and tell less of the volume.
        """
        return replace(self, before=(1 - data) * self.before).is_clearly_better


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
    out = blocks_to_leave_out(squares)
    both = out & np.all([one.usable for one in (*given.fits, *corrected.fits)], axis=0)
    block = np.unique(squares[both], return_inverse=True)[1]
    before, after = (one.left_out_errors[both] for one in (given, corrected))
    before, after = (np.bincount(block, own).astype(np.float64) for own in (before, after))
    return LeftOut(before, after, max(len(block), 1))


def without_left_out(fits: Sequence[Fit]) -> tuple[Fit, ...]:
    """Return fits that do not use the pixels that are left out."""
    kept = ~blocks_to_leave_out(_squares(fits))
    return tuple(
        replace(one, usable=one.usable & kept, trust=np.where(kept, one.trust, 0.0))
        for one in fits
    )


def _squares(fits: Sequence[Fit]) -> NDArray[np.intp]:
    """Return the square of each pixel: of single ones, neighbours would predict the most."""
    return fits[0].system.squares([SIDE] * len(fits[0].observation.rig))


def squared_errors(fits: Sequence[Fit]) -> NDArray[np.float64]:
    """Return the squared errors of fits without left-out pixels, over the images' mean square.

    Usable pixels count alike, as in the solve that the effects are found for.
    """
    errors, energy = np.zeros(len(fits[0].measured)), 0.0
    solved = [replace(fit, trust=fit.usable.astype(np.float64)) for fit in fits]
    for fit in without_left_out(solved):
        errors += np.square(next_fit(fit).residual)
        energy += float(np.mean(np.square(fit.measured)))
    return errors / (energy or 1.0)
