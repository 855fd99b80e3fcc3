"""Trial runs: reconstruct without some views, and measure how well those are predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import solve
from tomo.smooth_basis import SmoothBasis
from tomo.solve._drive import norm
from tomo.viewed import ViewedOperator

CHECKPOINTS = (1, 2, 3, 4, 5, 7, 10, 14, 20, 28, 40, 57, 80, 113)
"""The numbers of iterations at which a trial is judged."""

SETTLED = 0.97
HOPELESS = 1.5
"""Factors on the squared error that end a trial."""


def views_to_leave_out(views: Sequence[int]) -> list[list[int]]:
    """Return the views that each of two trials leaves out, spread over the rig.

    Up to eight views: one each, since every view counts. More: every eighth view each.
    """
    if len(views) <= 8:
        first = len(views) // 4
        return [[views[first]], [views[first + len(views) // 2]]]
    return [list(views[2::8]), list(views[6::8])]


@dataclass(frozen=True, eq=False)
class Trial:
    """Some views to reconstruct from, the others to be judged on.

    Attributes
    ----------
    training, left_out : ViewedOperator
    training_pixels, left_out_pixels : (pixels,) float32
    """

    training: ViewedOperator
    training_pixels: NDArray[np.float32]
    left_out: ViewedOperator
    left_out_pixels: NDArray[np.float32]

    @classmethod
    def leaving_out(
        cls,
        left_out: Sequence[int],
        views: Sequence[int],
        projector: ViewedOperator,
        measured: NDArray[np.float32],
    ) -> Trial:
        """Return the trial that trains on those of ``views`` that are not in ``left_out``."""
        training = [view for view in views if view not in left_out]
        return cls(
            projector.subset(training),
            measured[projector.pixels_of(training)],
            projector.subset(left_out),
            measured[projector.pixels_of(left_out)],
        )

    def squared_errors(
        self,
        method: str,
        width: float,
        settings: Mapping[str, Any],
        rival: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return the squared error of the left-out views at every checkpoint: (checkpoints,).

        From the third checkpoint on the run ends when the error falls by less than three per cent
        from one checkpoint to the next, or is far above what ``rival`` has at the same place.
        Checkpoints not reached are infinite.
        """
        errors = np.full(len(CHECKPOINTS), np.inf)
        basis = SmoothBasis(self.training, width) if width else None

        def judge(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if index not in CHECKPOINTS:
                return False
            at = CHECKPOINTS.index(index)
            seen = self.left_out @ (basis.blur(volume) if basis else volume)
            errors[at] = norm(seen - self.left_out_pixels) ** 2
            if at < 2:
                return False
            settled = errors[at] > SETTLED * errors[at - 1]
            return settled or (rival is not None and errors[at] > HOPELESS * rival[at])

        run = getattr(solve, method)
        run(basis or self.training, self.training_pixels, callback=judge, **settings)
        return errors
