"""Left-out pixels: a veto on corrections that predict them surely worse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.inference.fit import Fit
from tomo.inference.solve import next_fit
from tomo.selection.folds import blocks_to_leave_out

SURELY = 3.0
"""Standard errors of the blocks' differences from which a prediction is surely worse: voxels
imitate gas, and the better absorption may predict a little worse."""

SIDE = 4
"""Pixels along each side of the squares that are left out together: neighbours predict smaller
ones."""


@dataclass(frozen=True, eq=False)
class LeftOut:
    """How fits predict pixels that were left out of them, before a correction and after it.

    Attributes
    ----------
    before, after : (squares,) float64
        Squared errors over the images' mean square, summed over each square and all frames.
    """

    before: NDArray[np.float64]
    after: NDArray[np.float64]

    @property
    def is_surely_worse(self) -> bool:
        """Whether the correction predicts them worse, by more than chance."""
        more = self.after - self.before
        return bool(len(more) and more.sum() > SURELY * np.sqrt(len(more)) * more.std())


def predict_left_out(given: Sequence[Fit], corrected: Sequence[Fit]) -> LeftOut:
    """Return how fits of the same frames predict left-out pixels; those count that both use."""
    squares = given[0].system.squares([SIDE] * len(given[0].observation.rig))
    out = blocks_to_leave_out(squares)
    both = out & np.all([one.usable for one in (*given, *corrected)], axis=0)
    block = np.unique(squares[both], return_inverse=True)[1]
    before, after = (_errors(fits, out)[both] for fits in (given, corrected))
    return LeftOut(*(np.bincount(block, own).astype(np.float64) for own in (before, after)))


def _errors(fits: Sequence[Fit], out: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the squared errors of fits without some pixels, over the images' mean square."""
    errors, energy = np.zeros(len(out)), 0.0
    for fit in fits:
        kept = fit.usable & ~out
        found = next_fit(replace(fit, usable=kept, trust=np.where(kept, fit.trust, 0.0)))
        errors += np.square(found.residual)
        energy += float(np.mean(np.square(fit.measured)))
    return errors / (energy or 1.0)
