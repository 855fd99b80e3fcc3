"""The rounds of the default WERNet: weights are learnt, voxels solved for again, both judged."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.selection import Choice, choose_by_held_out_views
from tomo.selection.choose import residual_of_left_out_views, solve_as_chosen
from tomo.wernet.default.alternation import Alternation
from tomo.wernet.default.checkpoint import Learned, State
from tomo.wernet.default.linearised import volume_with
from tomo.wernet.default.ray_weights import RayWeights, corrections, reweighted, trend_corrections
from tomo.wernet.default.variable_projection import first_guess

WORTH_LEARNING = 0.95
"""The left-out views' residual must fall below this share of the chord lengths', or these stay:
with less an encoder's corrections explain noise and voxels' edges. So must what it adds to the
first guess, which itself has shown by patches what it is worth."""

NO_WORSE = 1.05
"""A first guess may predict single pixels worse by this factor: most of their misfit is what
voxels miss of edges, and that changes by more than a lens changes the light. With a lens as it
truly was they once were predicted worse by 3 %, by 5 % with another stop."""

SETTLED = 0.99
"""Training ends when the left-out views' residual falls by less than this factor."""

LARGEST_CORRECTION = 1e3
"""Weights a million times the chord lengths are no optics; squares of much larger ones are no
numbers in single precision. An encoder that gives such, or NaN, has diverged."""

PROMISING = 0.99
"""A new encoder must, by the end of its first round, predict rays that it has not been trained on
to this share of the misfit without it, or there is nothing for it to learn: to predict left-out
views better is harder."""

JUDGED_EVERY = 2
PATIENCE = 4
"""Rounds after which what is learnt must be worth it."""


@dataclass(eq=False)
class Rounds:
    """Where the alternation of weights and voxels stands, and the best that it came by.

    Parameters
    ----------
    projector : Projector
        Of chord lengths.
    measured : (pixels,) float32
    alternation : Alternation
        Trains the encoder and the tokens of the views.
    chords : Choice
        How the classic solve was chosen.
    volume : (unknowns,) float32
        The voxels to start from.
    unit : float
        Of the emission in front.
    last : int
        How many rounds there are to be at most.
    ended : str
        Why there are to be no more; empty while there are.
    weights : (pixels,) float32, optional
        What pixels are worth where voxels are solved for and judged.
    """

    projector: Projector
    measured: NDArray[np.float32]
    alternation: Alternation
    chords: Choice
    volume: NDArray[np.float32]
    unit: float
    last: int
    ended: str = ""
    weights: NDArray[np.float32] | None = None
    done: int = 0
    guessed: bool = False
    choice: Choice | None = None
    best: Learned | None = None
    previous: float = math.inf

    def state(self) -> State:
        """Return all that going on needs."""
        return State(
            self.done,
            self.volume,
            self.choice or self.chords,
            self.best,
            self.previous,
            self.ended,
            self.alternation.state(),
            self.guessed,
        )

    def restore(self, state: State) -> None:
        """Take up what `state` returned."""
        self.done, self.guessed = state.round, state.guessed
        self.volume, self.choice = state.volume, state.choice
        self.best, self.previous, self.ended = state.best, state.previous, state.ended
        self.alternation.restore(state.training)

    def guess(self) -> bool:
        """Begin with a first guess of the views' levels and of trends along the rays.

        Return whether there is one.
        """
        widest = self.alternation.features.widest
        guess = first_guess(self.projector, self.measured, self.chords, self.unit, widest)
        if guess is None:
            self.previous = self.chords.held_out_residual
            return False
        self.alternation.tokens.take(guess)
        return True

    def solve_guess(self) -> float:
        """Solve with the first guess and judge it; return the residual, NaN if it diverged."""
        self.guessed = True
        tokens, features = self.alternation.tokens, self.alternation.features
        self.volume = volume_with(
            self.projector, self.measured, features, tokens, self.chords, self.unit
        )
        return self._solve(self._front(), judged=True)

    def round(self, *, train: bool = True) -> float:
        """Learn and solve once more; return the relative residual, NaN where it diverged."""
        front = self._front()
        without = self._misfit_without_encoder(front) if train and self._may_have_nothing else None
        trained = None
        if train:
            beside = self._light_of_others(front)
            trained = self.alternation.round(self.done, self.volume, front, beside)
        self.done += 1
        if trained and not math.isfinite(trained.loss):
            self.ended = f"diverged in round {self.done}"
            return math.nan
        if trained and without is not None and trained.share_of(without) > PROMISING:
            what = "nothing more" if self.guessed else "nothing"
            self.ended = f"{what} to learn: rays are predicted no better by an encoder"
            return math.nan
        judged = self.done % JUDGED_EVERY == 0 or self.done >= self.last
        return self._solve(front, judged=judged, anew=train)

    @property
    def _may_have_nothing(self) -> bool:
        """Whether the round to come is a new encoder's first, among views that can be spared."""
        return self.alternation.encoder.is_zero and self.alternation.features.tells_views

    def _misfit_without_encoder(self, front: torch.Tensor) -> NDArray[np.float64]:
        """Return each ray's squared misfit with levels and trends alone, ``(rays,)``.

        Over the mean square of the images.
        """
        alternation = self.alternation
        correction = trend_corrections(alternation.tokens, alternation.features, front)
        seen = reweighted(self.projector, correction) @ self.volume
        # Squared in double precision: in single, squares know no 1e30 nor 1e-30.
        return np.square((seen - self.measured).astype(np.float64) / self.unit)

    def _light_of_others(self, front: torch.Tensor) -> NDArray[np.float32] | None:
        """Return what pixels see of other lines, less what others see of theirs, ``(rays,)``.

        By the weights as they are learnt by now. None where every pixel sees its own line alone.
        """
        if self.projector.rows_are_single_rays:
            return None
        learned = reweighted(self.projector, self._corrections(front))
        return (learned @ self.volume - learned.without_blur @ self.volume).astype(np.float32)

    def _corrections(self, front: torch.Tensor) -> NDArray[np.float32]:
        """Return the correction of each segment, ``(S,)``, as it is learnt by now."""
        own = self.alternation
        return corrections(own.encoder, own.tokens, own.features, front, own.over_parts)

    def _front(self) -> torch.Tensor:
        """Return the emission in front of each segment, ``(S,)``, by the voxels as they are."""
        return self.alternation.features.emission_in_front(self.volume, self.unit)

    def _solve(self, front: torch.Tensor, *, judged: bool, anew: bool = True) -> float:
        """Solve with the weights as they are learnt by now; return the relative residual.

        NaN, and nothing solved, where the weights have diverged. Weights that were not learnt
        from these images are judged as the chord lengths were solved for, not ``anew``.
        """
        alternation = self.alternation
        features, encoder, tokens = alternation.features, alternation.encoder, alternation.tokens
        correction = self._corrections(front)
        if not np.abs(correction).max(initial=0.0) <= LARGEST_CORRECTION:
            place = f"round {self.done}" if self.done else "the first guess"
            self.ended = f"diverged in {place}: corrections beyond any optics"
            return math.nan
        learned = reweighted(self.projector, correction)
        if judged:
            self.choice = self._choose(learned, anew)
        choice = self.choice or self.chords
        found = solve_as_chosen(learned, self.measured, choice, weights=self.weights)
        seen, self.volume = self.volume, self.projector.active.compress(found.volume)
        if judged:
            now = choice.held_out_residual
            if self.best is None or now < self._to_beat(self.best):
                weights = RayWeights(
                    copy.deepcopy(encoder),
                    copy.deepcopy(tokens),
                    seen,
                    self.unit,
                    features.tells_views,
                    features.widest,
                )
                self.best = Learned(
                    self.done,
                    now,
                    found.relative_residual,
                    found.volume,
                    dict(found.settings),
                    weights,
                )
            if now > SETTLED * self.previous:
                self.ended = f"settled after round {self.done}"
            elif self.done >= PATIENCE and not self.worth(now, WORTH_LEARNING):
                self.ended = f"nothing worth learning after round {self.done}"
            self.previous = now
        return found.relative_residual

    @staticmethod
    def _to_beat(best: Learned) -> float:
        """Return the residual that replaces the best: its few numbers speak for a first guess."""
        return best.held_out_residual * (1 if best.index else WORTH_LEARNING)

    def _choose(self, learned: Projector, anew: bool) -> Choice:
        """Return how to solve with learned weights, and how well left-out views are predicted.

        As for the chord lengths where that is better than a choice made anew which predicts
        left-out views worse than those did: weights are to be judged, not another stop.
        """
        found = None
        if anew and self.alternation.features.tells_views:
            found = choose_by_held_out_views(learned, self.measured, weights=self.weights)
            if found.held_out_residual <= self.chords.held_out_residual:
                return found
        now = residual_of_left_out_views(learned, self.measured, self.chords, self.weights)
        if found and found.held_out_residual <= now:
            return found
        return replace(self.chords, held_out_residual=now)

    def kept(self, few_views_worth: float) -> Learned | None:
        """Return the best that was learnt where it is worth it, else None: the classic solve.

        With few views it is where the residual is below ``few_views_worth`` of the chords'.
        """
        if self.best is None:
            return None
        share = WORTH_LEARNING if self.best.index else NO_WORSE
        if not self.alternation.features.tells_views:
            share = few_views_worth
        return self.best if self.worth(self.best.held_out_residual, share) else None

    def worth(self, residual: float, share: float) -> bool:
        """Say whether left-out views are predicted to ``share`` of the chords' residual."""
        return residual < share * self.chords.held_out_residual


def reason(ended: str, learned: Learned | None, residuals: Sequence[float]) -> str:
    """Return in a line why the rounds ended and what is returned.

    Parameters
    ----------
    ended : str
    learned : Learned or None
        What is returned; None for the classic solve.
    residuals : (float, float)
        Of left-out views, by chord lengths and by what was learnt.
    """
    chords, found = residuals
    both = f"{found:.4f}, chord lengths {chords:.4f}"
    if learned is None and math.isnan(found):
        return f"{ended}; the classic solve stays"
    if learned is None:
        return (
            f"{ended}; the classic solve stays: left-out views are not predicted clearly "
            f"better by learned weights (relative residual {both})"
        )
    source = f"of round {learned.index}" if learned.index else "of the first guess"
    return f"{ended}; learned weights {source} are kept: left-out views' relative residual {both}"
