"""Left-out pixels: a veto on corrections that predict them surely worse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tomo.inference.fit import Fit, next_fit
from tomo.selection.folds import blocks_to_leave_out

SURELY = 3.0
"""Standard errors of the blocks' differences from which a prediction is surely worse: voxels
imitate gas, and the better absorption may predict a little worse."""

SIDE = 4
"""Pixels along each side of the squares that are left out together: neighbours predict smaller
ones."""


def surely_worse(corrected: Fit, given: Fit) -> bool:
    """Return whether a fit predicts left-out pixels worse than another, by more than chance.

    Both are of the same pixels; those count that both use.
    """
    squares = given.system.squares([SIDE] * len(given.observation.rig))
    out = blocks_to_leave_out(squares)
    both = out & corrected.usable & given.usable
    if not both.any():
        return False
    block = np.unique(squares[both], return_inverse=True)[1]
    sums = (np.bincount(block, _errors(fit, out)[both]) for fit in (given, corrected))
    before, after = (one.astype(np.float64) for one in sums)
    more = after - before
    return bool(more.sum() > SURELY * np.sqrt(len(more)) * more.std())


def _errors(fit: Fit, out: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the squared errors of a fit without some pixels, over the images' energy."""
    kept = fit.usable & ~out
    found = next_fit(replace(fit, usable=kept, trust=np.where(kept, fit.trust, 0.0)))
    energy = float(np.mean(np.square(fit.measured))) or 1.0
    return np.square(found.residual) / energy
