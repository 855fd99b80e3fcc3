"""The outer iterations of the default WERNet: learn weights, solve for voxels, evaluate both."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.selection import Choice, choose_by_left_out_pixels, solve_as_chosen
from tomo.wernet.default.checkpoint import EvaluatedWeights, State
from tomo.wernet.default.encoder_training import EncoderTraining
from tomo.wernet.default.linearisation import volume_with
from tomo.wernet.default.patch_validation import evaluated
from tomo.wernet.default.ray_weights import (
    RayWeights,
    corrections,
    parametric_corrections,
    reweighted,
)
from tomo.wernet.default.variable_projection import fit_parametric_terms

WORTH_LEARNING = 0.95
"""Factor to which an encoder must lower the residual of left-out views, against segment lengths
and against parametric terms. Larger: corrections that explain noise are kept. Smaller: true ones
are dropped."""

NO_WORSE = 1.05
"""Factor by which parametric terms, accepted by patches, may predict single pixels worse. Smaller:
the error of voxels at edges decides. Larger: harmful terms are kept."""

FEW_VIEWS_NO_WORSE = 1.02
"""The same for all that is learned from few views: none can be spared to decide, and only what is
common to all views is learned."""

SETTLED = 0.99
"""Iterations end when the residual of left-out views falls by less than to this factor."""

LARGEST_CORRECTION = 1e3
"""Corrections above it count as divergence: weights are then a million times the segment
lengths. Squares of much larger ones overflow single precision."""

PROMISING = 0.99
"""Factor to which a new encoder must lower the misfit of rays not yet trained on, in its first
iteration. Larger: hopeless encoders cost whole solves. Smaller: slow starters are dropped."""

EVALUATED_EVERY = 2
"""Iterations from one evaluation by left-out views to the next, each of which takes as long as
several solves."""

PATIENCE = 4
"""Iterations after which the weights must be worth keeping."""


@dataclass(eq=False)
class OuterIterations:
    """The progress of the alternating minimisation, and the best weights so far.

    Parameters
    ----------
    projector : Projector
        Its entries are segment lengths.
    measured : (pixels,) float32
    training : EncoderTraining
    baseline : Choice
        How the classic solve with segment lengths was chosen.
    volume : (unknowns,) float32
        The voxels to start from.
    unit : float
        Unit of the upstream emission.
    limit : int
        Number of outer iterations at most.
    stop_reason : str
        Why there are to be no more iterations; empty while there are.
    weights : (pixels,) float32, optional
        Weights of the pixels where voxels are solved for and evaluated.
    pixel_blocks : (pixels,) int, optional
        Pixels that are left out together where smoothness is chosen.
    done : int
        Outer iterations done.
    has_terms : bool
        Whether the voxels were solved for with parametric terms before the first iteration.
    choice : Choice, optional
        How the voxels are solved for by now; as ``baseline`` when None.
    best : EvaluatedWeights, optional
    previous : float
        Residual of left-out views when last evaluated.
    """

    projector: Projector
    measured: NDArray[np.float32]
    training: EncoderTraining
    baseline: Choice
    volume: NDArray[np.float32]
    unit: float
    limit: int
    stop_reason: str = ""
    weights: NDArray[np.float32] | None = None
    pixel_blocks: NDArray[np.int64] | None = None
    done: int = 0
    has_terms: bool = False
    choice: Choice | None = None
    best: EvaluatedWeights | None = None
    previous: float = math.inf

    def state(self) -> State:
        """Return the state to resume from."""
        return State(
            self.done,
            self.volume,
            self.choice or self.baseline,
            self.best,
            self.previous,
            self.stop_reason,
            self.training.state(),
            self.has_terms,
        )

    def restore(self, state: State) -> None:
        """Resume from a `state`."""
        self.done, self.has_terms = state.iteration, state.has_terms
        self.volume, self.choice = state.volume, state.choice
        self.best, self.previous = state.best, state.previous
        self.stop_reason = state.stop_reason
        self.training.restore(state.training)

    def find_terms(self) -> bool:
        """Find the views' gains and the global terms; return whether there are any."""
        scale = self.training.features.image_scale
        found = fit_parametric_terms(
            self.projector, self.measured, self.baseline, self.unit, scale
        )
        if found is None:
            self.previous = self.baseline.held_out_residual
            return False
        self.training.view_parameters.copy_terms(found)
        return True

    def solve_with_terms(self) -> float:
        """Solve with the terms found and evaluate; return the residual, NaN if it diverged."""
        self.has_terms = True
        training = self.training
        self.volume = volume_with(
            self.projector,
            self.measured,
            training.features,
            training.view_parameters,
            self.baseline,
            self.unit,
        )
        return self._solve(self._upstream(), evaluate=True)

    def iterate(self, *, train: bool = True) -> float:
        """Learn and solve once more; return the relative residual, NaN where it diverged."""
        upstream = self._upstream()
        others = (
            self._squared_misfits_of_terms(upstream) if train and self._encoder_is_new else None
        )
        trained = None
        if train:
            neighbours = self._light_of_neighbours(upstream)
            trained = self.training.train(self.done, self.volume, upstream, neighbours)
        self.done += 1
        if trained and not math.isfinite(trained.loss):
            self.stop_reason = f"diverged in outer iteration {self.done}"
            return math.nan
        if trained and others is not None and trained.misfit_ratio(others) > PROMISING:
            nothing = "nothing more" if self.has_terms else "nothing"
            self.stop_reason = f"{nothing} to learn: an encoder does not predict rays better"
            return math.nan
        evaluate = self.done % EVALUATED_EVERY == 0 or self.done >= self.limit
        return self._solve(upstream, evaluate=evaluate, anew=train)

    @property
    def _encoder_is_new(self) -> bool:
        """Whether the next iteration is a new encoder's first, with views to spare."""
        return self.training.encoder.is_zero and self.training.features.per_view

    def _squared_misfits_of_terms(self, upstream: torch.Tensor) -> NDArray[np.float64]:
        """Return each ray's squared misfit without the encoder, over the mean square: (rays,)."""
        training = self.training
        correction = parametric_corrections(training.view_parameters, training.features, upstream)
        predicted = reweighted(self.projector, correction) @ self.volume
        # Squared in double precision: single precision cannot hold 1e30 nor 1e-30.
        return np.square((predicted - self.measured).astype(np.float64) / self.unit)

    def _light_of_neighbours(self, upstream: torch.Tensor) -> NDArray[np.float32] | None:
        """Return the light that an image blur brings to pixels less what it takes away: (rays,).

        It is computed with the present weights. None where rows are single rays.
        """
        if self.projector.rows_are_single_rays:
            return None
        learned = reweighted(self.projector, self._corrections(upstream))
        return (learned @ self.volume - learned.without_blur @ self.volume).astype(np.float32)

    def _corrections(self, upstream: torch.Tensor) -> NDArray[np.float32]:
        """Return the present correction of each segment, ``(S,)``."""
        own = self.training
        return corrections(
            own.encoder, own.view_parameters, own.features, upstream, own.map_chunks
        )

    def _upstream(self) -> torch.Tensor:
        """Return the upstream emission of each segment in the present voxels, ``(S,)``."""
        return self.training.features.upstream_emission(self.volume, self.unit)

    def _solve(self, upstream: torch.Tensor, *, evaluate: bool, anew: bool = True) -> float:
        """Solve with the present weights; return the relative residual.

        It is NaN, and nothing is solved, where the weights have diverged. Unless ``anew``, weights
        are evaluated with the solve of the segment lengths: they were not learned here.
        """
        correction = self._corrections(upstream)
        if not np.abs(correction).max(initial=0.0) <= LARGEST_CORRECTION:
            where = f"outer iteration {self.done}" if self.done else "the parametric terms"
            self.stop_reason = (
                f"diverged in {where}: a correction is not finite or above {LARGEST_CORRECTION:g}"
            )
            return math.nan
        learned = reweighted(self.projector, correction)
        if evaluate:
            self.choice = self._choose(learned, anew)
        choice = self.choice or self.baseline
        found = solve_as_chosen(learned, self.measured, choice, weights=self.weights)
        upstream_volume, self.volume = (
            self.volume,
            self.projector.active.compress(found.volume),
        )
        if evaluate:
            now = choice.held_out_residual
            if self.best is None or now < self._to_beat(self.best):
                self.best = EvaluatedWeights(
                    self.done,
                    now,
                    found.relative_residual,
                    found.volume,
                    dict(found.settings),
                    self._ray_weights(upstream_volume),
                )
            if now > SETTLED * self.previous:
                self.stop_reason = f"settled after outer iteration {self.done}"
            elif self.done >= PATIENCE and not self._below_baseline(now, WORTH_LEARNING):
                self.stop_reason = f"nothing worth learning after outer iteration {self.done}"
            self.previous = now
        return found.relative_residual

    def _ray_weights(self, upstream_volume: NDArray[np.float32]) -> RayWeights:
        """Return a copy of the present weights, computed from that volume."""
        features = self.training.features
        return RayWeights(
            copy.deepcopy(self.training.encoder),
            copy.deepcopy(self.training.view_parameters),
            upstream_volume,
            self.unit,
            features.per_view,
            features.image_scale,
        )

    @staticmethod
    def _to_beat(best: EvaluatedWeights) -> float:
        """Return the residual that replaces the best: parametric terms have few numbers."""
        return best.held_out_residual * (1 if best.index else WORTH_LEARNING)

    def _choose(self, learned: Projector, anew: bool) -> Choice:
        """Return how to solve with learned weights, and how well left-out views are predicted.

        A choice made anew that predicts left-out views worse than segment lengths do gives way to
        the solve of the segment lengths where that is better: weights are evaluated, not stops.
        """
        found = None
        if anew and self.training.features.per_view:
            how = {"blocks": self.pixel_blocks, "weights": self.weights}
            found = choose_by_left_out_pixels(learned, self.measured, **how)
            found = evaluated(learned, self.measured, found, self.weights)
            if found.held_out_residual <= self.baseline.held_out_residual:
                return found
        as_before = evaluated(learned, self.measured, self.baseline, self.weights)
        if found and found.held_out_residual <= as_before.held_out_residual:
            return found
        return as_before

    def kept(self) -> EvaluatedWeights | None:
        """Return the best weights where they are worth it; None where segment lengths stay."""
        if self.best is None:
            return None
        factor = WORTH_LEARNING if self.best.index else NO_WORSE
        if not self.training.features.per_view:
            factor = FEW_VIEWS_NO_WORSE
        return self.best if self._below_baseline(self.best.held_out_residual, factor) else None

    def _below_baseline(self, residual: float, factor: float) -> bool:
        """Return whether a residual of left-out views is below ``factor`` times the baseline's."""
        return residual < factor * self.baseline.held_out_residual
