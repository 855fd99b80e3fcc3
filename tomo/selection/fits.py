"""Fits of one width and strength, stopped where they predict the left-out pixels best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress
from tomo.selection.folds import Fold
from tomo.selection.smooth_solve import smooth_start, solve_smoothly

CHECKPOINTS = (5, 10, 15, 20, 28, 40, 56, 80)
"""Iterations after which the prediction error is computed."""

SETTLED, STILL_FALLING = 1e-4, 0.03
"""A fit ends when a checkpoint gains less than the first fraction of the whole gain, and less than
the second of the remaining error: noise hides gains of the one, clean images have them of the
other. Larger values stop early, smaller ones only cost time."""

CATCHING_UP = 3
"""A fit also ends where so many gains like its last would not reach the best fit so far. Fewer
give up strengths that would have won."""


class Tried(NamedTuple):
    """A setting that was tried, and the relative residual of the left-out pixels."""

    width: float
    strength: float
    iterations: int
    held_out_residual: float


@dataclass(frozen=True)
class Fit:
    """A setting's squared error of the left-out pixels, at its best number of iterations."""

    width: float
    strength: float
    iterations: int
    error: float


@dataclass(eq=False)
class Fits:
    """The folds that compare settings, and the fits so far.

    There are no ``folds`` where no pixel can be left out: every setting is as good then.
    ``total`` are the fits that the progress counts to.
    """

    folds: Sequence[Fold]
    progress: Progress | None = None
    total: int = 12
    done: dict[tuple[float, float], Fit] = field(default_factory=dict)

    def at(self, width: float, strength: float) -> Fit:
        """Return the fit of a setting; it is run where it was not yet."""
        key = width, strength
        if key not in self.done:
            if self.progress:
                number = len(self.done) + 1
                where = f"choosing: setting {number}, width {width:g}, strength {strength:g}"
                self.progress(min(len(self.done), self.total - 1), self.total, where)
            self.done[key] = self._run(width, strength)
        return self.done[key]

    def residual(self, fit: Fit) -> float:
        """Return the relative residual of the left-out pixels."""
        return float(np.sqrt(fit.error / self._light))

    @property
    def tried(self) -> tuple[Tried, ...]:
        """All fits so far."""
        return tuple(
            Tried(each.width, each.strength, each.iterations, self.residual(each))
            for each in self.done.values()
        )

    @cached_property
    def _light(self) -> float:
        return sum(fold.squared_light for fold in self.folds) or 1.0

    @cached_property
    def _starts(self) -> list[NDArray[np.float32]]:
        return [smooth_start(fold.training, fold.training_pixels) for fold in self.folds]

    def _run(self, width: float, strength: float) -> Fit:
        """Run every fold, and stop all of them where together they predict best."""
        to_reach = min((fit.error for fit in self.done.values()), default=np.inf)
        both = zip(self.folds, self._starts, strict=True)
        runs = [_errors(fold, start, width, strength, to_reach) for fold, start in both]
        # a fold that settled earlier stays as it was
        length = max(map(len, runs), default=1)
        errors = [sum(run[min(at, len(run) - 1)] for run in runs) for at in range(length)]
        stop = int(np.argmin(errors))
        return Fit(width, strength, CHECKPOINTS[stop], errors[stop])


def _errors(
    fold: Fold, start: NDArray[np.float32], width: float, strength: float, to_reach: float
) -> list[float]:
    """Return the errors of the left-out pixels at the checkpoints that a fit reaches."""
    errors: list[float] = []

    def evaluate(index: int, volume: NDArray[np.float32], _residual: float) -> bool:
        if index not in CHECKPOINTS:
            return False
        errors.append(float(fold.squared_errors(volume).sum()))
        if len(errors) < 2:
            return False
        before, now = errors[-2:]
        enough = min(SETTLED * (fold.squared_light - now), STILL_FALLING * now)
        return before - now < enough or now - CATCHING_UP * (before - now) > to_reach

    found = solve_smoothly(
        fold.training,
        fold.training_pixels,
        width=width,
        strength=strength,
        iterations=CHECKPOINTS[-1],
        start=start,
        weights=fold.training_weights,
        callback=evaluate,
    )
    if not errors:  # it converged before the first checkpoint
        volume = fold.training.active.compress(found.volume)
        errors.append(float(fold.squared_errors(volume).sum()))
    return errors
