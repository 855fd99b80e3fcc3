"""The outer iterations of the default WERNet: learn weights, solve for voxels, judge both."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.selection import Choice
from tomo.selection.folds import surely_lower
from tomo.wernet.default.checkpoint import JudgedWeights, State
from tomo.wernet.default.encoder_training import EncoderTraining
from tomo.wernet.default.left_out import Judged, LeftOut
from tomo.wernet.default.ray_features import TERMS
from tomo.wernet.default.ray_weights import RayWeights, corrections, reweighted
from tomo.wernet.default.variable_projection import GAINS, fit_parametric_terms

LARGEST_CORRECTION = 1e3
"""Corrections above it count as divergence: weights are then a million times the segment
lengths. Squares of much larger ones overflow single precision."""

PATIENCE = 2
"""Outer iterations without a surely better prediction after which they end. Fewer: slow starters
are dropped. More: time."""


@dataclass(eq=False)
class OuterIterations:
    """The progress of the alternating minimisation, and the best weights so far.

    Parameters
    ----------
    pixels : LeftOut
        The pixels to learn from, and those to judge by.
    training : EncoderTraining
    choice : Choice
        How voxels are solved for.
    limit : int
        Number of outer iterations at most.
    volume : (unknowns,) float32, optional
        The voxels to start from; those of the segment lengths when None.
    stop_reason : str
        Why there are to be no more iterations; empty while there are.
    done : int
        Outer iterations done.
    has_terms : bool
        Whether parametric terms were found before the first iteration.
    best : JudgedWeights, optional
        None while segment lengths predict left-out pixels best.
    last : Judged, optional
        The solve with the present weights.
    residual : float
        Relative residual of left-out pixels by the weights that were tried last; NaN: none were.
    """

    pixels: LeftOut
    training: EncoderTraining
    choice: Choice
    limit: int
    volume: NDArray[np.float32] | None = None
    stop_reason: str = ""
    done: int = 0
    has_terms: bool = False
    best: JudgedWeights | None = None
    last: Judged | None = None
    residual: float = math.nan

    @cached_property
    def lengths(self) -> Judged:
        """The solve with segment lengths."""
        return self.pixels.judge(self.pixels.projector, self.choice)

    @property
    def projector(self) -> Projector:
        """The rays of all pixels; its entries are segment lengths."""
        return self.pixels.projector

    def state(self) -> State:
        """Return the state to resume from."""
        return State(
            self.done,
            self.voxels,
            self.best,
            self.residual,
            self.stop_reason,
            self.training.state(),
            self.has_terms,
        )

    def restore(self, state: State) -> None:
        """Resume from a `state`."""
        self.done, self.has_terms = state.iteration, state.has_terms
        self.volume, self.best = state.volume, state.best
        self.residual, self.stop_reason = state.residual, state.stop_reason
        self.training.restore(state.training)

    @property
    def voxels(self) -> NDArray[np.float32]:
        """The present voxels, (unknowns,)."""
        return self.lengths.volume if self.volume is None else self.volume

    def find_terms(self) -> Judged | None:
        """Find the global terms, and the views' gains; return the solve with them, if any."""
        features, how = (
            self.training.features,
            (self.choice, self.pixels.unit, lambda: self.lengths),
        )
        candidates = {*range(len(TERMS)), GAINS}
        parameters, self.last = fit_parametric_terms(self.pixels, features, *how, candidates)
        self.residual = self.pixels.residual(self.last)
        if parameters is None or self.last is None:
            return None
        self.has_terms = True
        self.training.view_parameters.copy_terms(parameters)
        before = self.last.volume if self.volume is None else self.volume
        self.best = JudgedWeights(0, self.last.errors, self._ray_weights(before))
        if self.volume is None:
            self.volume = self.last.volume
        return self.last

    def iterate(self, *, train: bool = True) -> float:
        """Learn and solve once more; return the training's residual, NaN where it diverged."""
        features, before = self.training.features, self.voxels
        upstream = features.upstream_emission(before, self.pixels.unit)
        loss = self.training.train(self.done, before, upstream) if train else 0.0
        self.done += 1
        if not math.isfinite(loss):
            self.stop_reason = f"diverged in outer iteration {self.done}"
            return math.nan
        own = self.training
        correction = corrections(
            own.encoder, own.view_parameters, own.features, upstream, own.map_chunks
        )
        if not np.abs(correction).max(initial=0.0) <= LARGEST_CORRECTION:
            self.stop_reason = (
                f"diverged in outer iteration {self.done}: a correction is not finite or above "
                f"{LARGEST_CORRECTION:g}"
            )
            return math.nan
        self.last = self.pixels.judge(reweighted(self.projector, correction), self.choice)
        self.volume, self.residual = self.last.volume, self.pixels.residual(self.last)
        to_beat = self.best.errors if self.best else self.lengths.errors
        if surely_lower(self.last.errors, to_beat):  # what encoders learn is finer than blocks
            self.best = JudgedWeights(self.done, self.last.errors, self._ray_weights(before))
        elif self.done - (self.best.index if self.best else 0) >= PATIENCE:
            more = " more" if self.best else ""
            self.stop_reason = f"nothing{more} to learn after outer iteration {self.done}"
        return self.last.training_residual

    def _ray_weights(self, upstream_volume: NDArray[np.float32]) -> RayWeights:
        """Return a copy of the present weights, computed from that volume."""
        features = self.training.features
        return RayWeights(
            copy.deepcopy(self.training.encoder),
            copy.deepcopy(self.training.view_parameters),
            upstream_volume,
            self.pixels.unit,
            features.per_view,
            features.image_scale,
        )

    def residuals(self) -> tuple[float, float]:
        """Return the relative residuals of left-out pixels: segment lengths, learned weights.

        Learned are the best weights, or the last where none are better. NaN where none were.
        """
        if math.isnan(self.residual):
            return self.choice.held_out_residual, math.nan
        if self.best is None:
            return self.pixels.residual(self.lengths), self.residual
        learned = self.lengths._replace(errors=self.best.errors)
        return self.pixels.residual(self.lengths), self.pixels.residual(learned)
