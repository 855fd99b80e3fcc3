"""Trial runs: reconstruct without some views, and measure how well those are predicted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import solve
from tomo._sums import norm
from tomo.smooth_basis import SmoothBasis
from tomo.solve._common_start import common_start
from tomo.viewed import ViewedOperator

MULTIPLICATIVE = ("mlem",)
"""Methods that start from `Trial.start`."""

CHECKPOINTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20, 24, 28, 34, 40)
"""The numbers of iterations at which a trial is judged."""

SETTLED = 1e-4
"""A trial ends when one checkpoint gains less than this share of what all have gained."""

PATIENCE = 10
HOPELESS = 0.05
"""A trial ends when, after so many iterations, it lacks more than this share of what the best
one gained. Shares of gains, not of errors: the noise of the left-out views is in every error."""


def views_to_leave_out(views: Sequence[int]) -> list[list[int]]:
    """Return the views that each trial leaves out, spread over the rig.

    Up to eight views: two trials without one view each, since every view counts. More: one trial
    without every eighth view.
    """
    if len(views) <= 8:
        first = len(views) // 4
        return [[views[first]], [views[first + len(views) // 2]]]
    return [list(views[2::8])]


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
        """Return the trial that trains on those of ``views`` that are not in ``left_out``.

        Left-out pixels that see no voxel are taken for dark: no candidate predicts anything else,
        and what they show would hide by how much candidates differ.
        """
        training = [view for view in views if view not in left_out]
        judging = projector.subset(left_out)
        shown = measured[projector.pixels_of(left_out)]
        return cls(
            projector.subset(training),
            measured[projector.pixels_of(training)],
            judging,
            np.where(judging.row_sums > 0, shown, np.float32(0)),
        )

    @cached_property
    def start(self) -> NDArray[np.float32]:
        """Where multiplicative methods start: `tomo.solve._common_start`."""
        return common_start(self.training, self.training_pixels)

    def squared_errors(
        self,
        method: str,
        width: float,
        settings: Mapping[str, Any],
        best: float = 0.0,
    ) -> NDArray[np.float64]:
        """Return the squared error of the left-out views at every checkpoint: (checkpoints,).

        From the third checkpoint on the run ends when the error hardly falls any more, or is far
        above ``best``, that of another candidate. Checkpoints not reached are infinite.
        """
        errors = np.full(len(CHECKPOINTS), np.inf)
        basis = SmoothBasis(self.training, width) if width else None
        run = getattr(solve, method)
        start = self.start if method in MULTIPLICATIVE else None

        def judge(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if index not in CHECKPOINTS:
                return False
            at = CHECKPOINTS.index(index)
            seen = self.left_out @ (basis.blur(volume) if basis else volume)
            errors[at] = norm(seen - self.left_out_pixels) ** 2
            if at < 2:
                return False
            dark = norm(self.left_out_pixels) ** 2  # the error of an empty volume
            settled = errors[at - 1] - errors[at] < SETTLED * (dark - errors[at])
            behind = errors[at] - best > HOPELESS * (dark - best)
            return settled or (index >= PATIENCE and best > 0 and behind)

        run(basis or self.training, self.training_pixels, start=start, callback=judge, **settings)
        return errors
