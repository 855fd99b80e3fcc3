"""Trial runs: reconstruct without some views and pixels; measure how well those are predicted."""

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
from tomo.solvers.initial_volume import common_start
from tomo.solvers.mlem import interleaved

FEW_VIEWS = 8
"""Up to so many views each counts: one of them is left out."""

MULTIPLICATIVE = ("mlem",)
"""Methods that start from `Trial.start`."""

CHECKPOINTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 17, 20, 24, 28, 34, 40, 48, 57, 68, 80)
"""The numbers of iterations at which a trial is judged."""

SETTLED = 1e-4
"""A trial ends when one checkpoint gains less than this share of what all have gained."""

STILL_FALLING = 0.03
"""A patient one goes on while it gains this share of what is left: clean images are worth it."""

PATIENCE = 10
HOPELESS = 0.05
"""A trial ends when, after so many iterations, it lacks more than this share of what the best
one gained. Shares of gains, not of errors: the noise of what is left out is in every error."""

CATCHING_UP = 4
"""So does one that would not reach the best by so many gains like its last one. By two, a wide
basis was given up with photon noise that was the better one in the end."""

SPARED = 8
"""With few views a trial also leaves out every so-many-th pixel of the views that it keeps."""

FEWEST_SPARED = 200
"""Fewer of them tell nothing for sure, and would be missed: on flames a few voxels wide, seen by
some hundred pixels, they asked for a smoothness that cost a factor of three."""


def views_to_leave_out(views: Sequence[int]) -> list[list[int]]:
    """Return the views that each trial leaves out.

    With few views one, else every eighth.
    """
    if len(views) <= FEW_VIEWS:
        return [[views[max(len(views) // 4, 1)]]]
    return [list(views[2::8])]


def weighed(
    pixels: NDArray[np.float32], weights: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Return pixels whose squares count as much as ``weights`` say; all alike when None."""
    return pixels if weights is None else np.sqrt(weights) * pixels


@dataclass(frozen=True, eq=False)
class Trial:
    """Some pixels to reconstruct from, others to be judged on.

    Attributes
    ----------
    training, left_out : ProjectionOperator
    training_pixels, left_out_pixels : (pixels,) float32
    training_weights, left_out_weights : (pixels,) float32, optional
        What pixels are worth to least squares, and when they are judged; all alike when None.
    spared : (left-out pixels,) bool
        Of views that are trained on, else of views left out. What views leave open shows in
        whole views that are left out; noise shows in both, but where views are few the former
        hides it there.
    """

    training: ProjectionOperator
    training_pixels: NDArray[np.float32]
    left_out: ProjectionOperator
    left_out_pixels: NDArray[np.float32]
    spared: NDArray[np.bool_]
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
        sparing: bool = False,
        weights: NDArray[np.float32] | None = None,
    ) -> Trial:
        """Return the trial that trains on those of ``views`` that are not in ``left_out``.

        On all of their pixels, or where it is ``sparing`` on those not `SPARED`; where these would
        be fewer than `FEWEST_SPARED` none is. Left-out pixels that see no voxel are taken for
        dark: no candidate predicts anything else, and what they show would hide by how much
        candidates differ. ``weights`` (pixels,) are those of all pixels.
        """
        pixels = projector.pixels_of([view for view in views if view not in left_out])
        own = projector.pixels_of(left_out)
        sparing = sparing and len(pixels) >= SPARED * FEWEST_SPARED
        spared = pixels[interleaved(len(pixels), SPARED)[0]] if sparing else pixels[:0]
        judged = np.sort(np.concatenate([own, spared]))
        training = np.setdiff1d(pixels, spared, assume_unique=True)
        judging = projector.take(judged)
        shown = measured[judged]
        return cls(
            projector.take(training),
            measured[training],
            judging,
            np.where(judging.row_sums > 0, shown, np.float32(0)),
            np.isin(judged, spared, assume_unique=True),
            None if weights is None else weights[training],
            None if weights is None else weights[judged],
        )

    @cached_property
    def start(self) -> NDArray[np.float32]:
        """Where multiplicative methods start: `tomo.solvers.initial_volume`."""
        return common_start(self.training, self.training_pixels)

    def squared_error(self, volume: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the squared errors ``(2,)`` of views left out and of pixels spared.

        The latter as if there were as many of them as of the former: both count alike.
        """
        misfit = self.left_out @ volume - self.left_out_pixels
        misfit = weighed(misfit, self.left_out_weights)
        of_views, of_spared = norm(misfit[~self.spared]) ** 2, norm(misfit[self.spared]) ** 2
        return np.array([of_views, of_spared * self._share])

    @cached_property
    def dark(self) -> NDArray[np.float64]:
        """`squared_error` of an empty volume."""
        return self.squared_error(np.zeros(self.left_out.shape[1], np.float32))

    @cached_property
    def _share(self) -> float:
        """How many pixels of left-out views there are for one that is spared."""
        return np.count_nonzero(~self.spared) / max(np.count_nonzero(self.spared), 1)

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

        From the third of them on the run ends when the sum hardly falls any more (``patient``:
        nor by a share of what is left), unless it is to go ``to_the_end``, or will not come down
        to ``best``, that of another candidate; at the last checkpoint in any case. Checkpoints
        not reached are infinite, but for the first where it settles even before.
        """
        errors = np.full((len(CHECKPOINTS), 2), np.inf)
        basis = GaussianBasis(self.training, width) if width else None
        run = getattr(solvers, method)
        start = self.start if method in MULTIPLICATIVE else None
        dark = float(self.dark.sum())
        first = bisect.bisect_right(CHECKPOINTS, after)

        def judge(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
            if index not in CHECKPOINTS[first:]:
                return False
            at = CHECKPOINTS.index(index)
            errors[at] = self.squared_error(basis.blur(volume) if basis else volume)
            if at < first + 2:
                return False
            before, now = errors[at - 1 : at + 1].sum(axis=1)
            enough = min(SETTLED * (dark - now), STILL_FALLING * now if patient else math.inf)
            settled = before - now < enough
            lacking = min(HOPELESS * (dark - best), CATCHING_UP * (before - now))
            behind = index >= after + PATIENCE and best > 0 and now - best > lacking
            return behind or (settled and not to_the_end) or index == CHECKPOINTS[-1]

        found = run(
            basis or self.training, self.training_pixels, start=start, callback=judge, **settings
        )
        if not np.isfinite(errors).any():  # it had settled before there was anything to judge
            volume = basis.volume(found.volume) if basis else found.volume
            errors[first] = self.squared_error(self.training.active.compress(volume))
        return errors
