"""Cross-validation folds: reconstruct without some views and pixels, and predict those."""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import solvers
from tomo._compute.reductions import norm
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.subsets import interleaved

FEW_VIEWS = 8
"""Views up to which only one is left out; more views leave out every eighth."""

MULTIPLICATIVE = ("mlem",)
"""Methods that need a positive start, see `Fold.start`."""

CHECKPOINTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20, 24, 28, 34, 40, 48, 57, 68, 80)
"""Iterations after which the prediction error is computed."""

SETTLED = 1e-4
"""A fit has converged when one checkpoint gains less than this fraction of the whole gain.
Larger values stop early, smaller ones only cost time."""

STILL_FALLING = 0.03
"""A patient fit goes on while a checkpoint gains this fraction of the remaining error."""

PATIENCE = 10
HOPELESS = 0.05
"""After so many iterations a fit ends when it is behind the best by this fraction of the best's
gain. Gains are compared, not errors: every error contains the noise of the left-out data."""

CATCHING_UP = 4
"""A fit also ends when so many gains like its last one would not reach the best. Two gave up
bases that would have won."""

PIXEL_STRIDE = 8
"""With few views a fold also leaves out every eighth pixel of its training views."""

FEWEST_SCATTERED = 200
"""Least number of scattered pixels. Fewer choose the smoothness by chance, and the training
misses them."""


def views_to_leave_out(views: Sequence[int]) -> list[list[int]]:
    """Return the views that each fold leaves out.

    One with few views, else every eighth.
    """
    if len(views) <= FEW_VIEWS:
        return [[views[max(len(views) // 4, 1)]]]
    return [list(views[2::8])]


def weighed(
    pixels: NDArray[np.float32], weights: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Return ``sqrt(weights) * pixels``; the pixels themselves when ``weights`` is None."""
    return pixels if weights is None else np.sqrt(weights) * pixels


@dataclass(frozen=True, eq=False)
class Fold:
    """Pixels to reconstruct from, and left-out pixels to predict.

    Attributes
    ----------
    training, left_out : ProjectionOperator
    training_pixels, left_out_pixels : (pixels,) float32
    training_weights, left_out_weights : (pixels,) float32, optional
        Weights of the squared residuals, in training and evaluation; all 1 when None.
    scattered : (left-out pixels,) bool
        True for scattered left-out pixels of the training views, False for pixels of left-out
        views. Left-out views show what the other views leave undetermined; with few views that
        hides the noise, which the scattered pixels show.
    """

    training: ProjectionOperator
    training_pixels: NDArray[np.float32]
    left_out: ProjectionOperator
    left_out_pixels: NDArray[np.float32]
    scattered: NDArray[np.bool_]
    training_weights: NDArray[np.float32] | None = None
    left_out_weights: NDArray[np.float32] | None = None

    @classmethod
    def leaving_out(
        cls,
        left_out: Sequence[int],
        views: Sequence[int],
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        *,
        scatter: bool = False,
        weights: NDArray[np.float32] | None = None,
    ) -> Fold:
        """Return the fold that trains on the ``views`` without ``left_out``.

        With ``scatter`` every `PIXEL_STRIDE`-th training pixel is left out as well, unless these
        are fewer than `FEWEST_SCATTERED`. Left-out pixels that see no voxel are set to 0: every
        candidate predicts 0 there, and their light would only hide differences. ``weights``
        (pixels,) are those of all pixels.
        """
        pixels = projector.pixels_of([view for view in views if view not in left_out])
        own = projector.pixels_of(left_out)
        scatter = scatter and len(pixels) >= PIXEL_STRIDE * FEWEST_SCATTERED
        scattered = pixels[interleaved(len(pixels), PIXEL_STRIDE)[0]] if scatter else pixels[:0]
        held = np.sort(np.concatenate([own, scattered]))
        training = np.setdiff1d(pixels, scattered, assume_unique=True)
        evaluated = projector.take(held)
        shown = measured[held]
        return cls(
            projector.take(training),
            measured[training],
            evaluated,
            np.where(evaluated.row_sums > 0, shown, np.float32(0)),
            np.isin(held, scattered, assume_unique=True),
            None if weights is None else weights[training],
            None if weights is None else weights[held],
        )

    @cached_property
    def start(self) -> NDArray[np.float32]:
        """The start of multiplicative methods, see `tomo.solvers.initial_volume`."""
        return mlos_start(self.training, self.training_pixels)

    def squared_error(self, volume: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the squared errors ``(2,)`` of left-out views and of scattered pixels.

        The second is scaled to as many pixels as the first has: both count alike.
        """
        misfit = self.left_out @ volume - self.left_out_pixels
        misfit = weighed(misfit, self.left_out_weights)
        view_error, pixel_error = (
            norm(misfit[~self.scattered]) ** 2,
            norm(misfit[self.scattered]) ** 2,
        )
        return np.array([view_error, pixel_error * self._ratio])

    @cached_property
    def dark(self) -> NDArray[np.float64]:
        """`squared_error` of an empty volume."""
        return self.squared_error(np.zeros(self.left_out.shape[1], np.float32))

    @cached_property
    def _ratio(self) -> float:
        """Pixels of left-out views per scattered pixel."""
        return np.count_nonzero(~self.scattered) / max(np.count_nonzero(self.scattered), 1)

    def squared_errors(
        self,
        method: str,
        width: float,
        settings: Mapping[str, Any],
        best: float = 0.0,
        *,
        after: int = 0,
        patient: bool = False,
        to_the_end: bool = False,
    ) -> NDArray[np.float64]:
        """Return `squared_error` at every checkpoint beyond ``after``: ``(checkpoints, 2)``.

        From the third checkpoint on the run ends when the sum has converged (`SETTLED`, and
        `STILL_FALLING` when ``patient``), unless it runs ``to_the_end``, or when it will not
        reach ``best``, another candidate's error. Checkpoints not reached are infinite; the first
        is always evaluated.
        """
        errors = np.full((len(CHECKPOINTS), 2), np.inf)
        basis = GaussianBasis(self.training, width) if width else None
        run = getattr(solvers, method)
        start = self.start if method in MULTIPLICATIVE else None
        dark = float(self.dark.sum())
        first = bisect.bisect_right(CHECKPOINTS, after)

        def evaluate(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if index not in CHECKPOINTS[first:]:
                return False
            at = CHECKPOINTS.index(index)
            errors[at] = self.squared_error(basis.to_voxels(volume) if basis else volume)
            if at < first + 2:
                return False
            before, now = errors[at - 1 : at + 1].sum(axis=1)
            enough = min(SETTLED * (dark - now), STILL_FALLING * now if patient else math.inf)
            settled = before - now < enough
            lacking = min(HOPELESS * (dark - best), CATCHING_UP * (before - now))
            behind = index >= after + PATIENCE and best > 0 and now - best > lacking
            return behind or (settled and not to_the_end) or index == CHECKPOINTS[-1]

        found = run(
            basis or self.training,
            self.training_pixels,
            start=start,
            callback=evaluate,
            **settings,
        )
        if not np.isfinite(errors).any():  # it converged before the first checkpoint
            volume = basis.volume(found.volume) if basis else found.volume
            errors[first] = self.squared_error(self.training.active.compress(volume))
        return errors
