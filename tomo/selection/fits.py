"""Fits of one width and strength, stopped where they predict the left-out pixels best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress
from tomo.selection.folds import Fold
from tomo.selection.smooth_solve import solve_smoothly

CHECKPOINTS = (5, 10, 15, 20, 28, 40, 56, 80)
"""Iterations after which the prediction error is computed."""

WALK = 40
"""Iterations after which settings are compared at the latest. Fewer take slow settings for bad
ones (20: 4 % worse volumes), more cost time."""

SETTLED, STILL_FALLING, AT_REST = 1e-4, 0.03, 0.01
"""A fit ends when a checkpoint gains less than the first fraction of the whole gain, and less than
the second of the remaining error, the third where it is the last: noise hides gains of the one,
clean images have them of the other. Larger values stop early, smaller ones only cost time."""

CATCHING_UP = 3
"""A fit also ends where so many gains like its last would not reach the best fit so far. Fewer
give up strengths that would have won."""


class Tried(NamedTuple):
    """A setting that was tried, and the relative residual of the left-out pixels."""

    width: float
    strength: float
    iterations: int
    held_out_residual: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A setting's squared error of the left-out pixels, at its best number of iterations."""

    width: float
    strength: float
    iterations: int
    error: float


@dataclass(eq=False)
class Fits:
    """The folds that compare settings, and the fits so far.

    Attributes
    ----------
    folds : sequence of Fold
    progress : callable, optional
    total : int
        Fits that the progress counts to.
    """

    folds: Sequence[Fold]
    progress: Progress | None = None
    total: int = 0
    done: dict[tuple[float, float], Fit] = field(default_factory=dict)

    @property
    def best(self) -> Fit:
        """The fit of the least error to the first fold so far."""
        return min(self.done.values(), key=lambda fit: fit.error)

    def of_width(self, width: float) -> Fit | None:
        """Return the best fit of a width to the first fold so far."""
        known = (fit for fit in self.done.values() if fit.width == width)
        return min(known, key=lambda fit: fit.error, default=None)

    def at(self, width: float, strength: float, iterations: int = WALK) -> Fit:
        """Return the fit of a setting to the first fold; it is run where it was not yet."""
        key = width, strength
        if key not in self.done:
            if self.progress:
                number = len(self.done) + 1
                where = f"choosing: setting {number}, width {width:g}, strength {strength:g}"
                self.progress(min(len(self.done), self.total - 1), self.total, where)
            to_reach = self.best.error if self.done else np.inf
            self.done[key] = self._run(self.folds[:1], *key, iterations, to_reach)
        return self.done[key]

    def to_the_end(self, width: float, strength: float) -> Fit:
        """Return the fit of a setting to the first fold with as many iterations as it needs."""
        key = width, strength
        self.done[key] = self._run(self.folds[:1], *key, CHECKPOINTS[-1], still=AT_REST)
        return self.done[key]

    def to_all_folds(self, fit: Fit) -> Fit:
        """Return the fit of a setting to all folds, to the others with as many iterations."""
        if len(self.folds) == 1:
            return fit
        others = self._run(self.folds[1:], fit.width, fit.strength, fit.iterations)
        return replace(fit, error=fit.error + others.error)

    def residual(self, fit: Fit, folds: int = 1) -> float:
        """Return the relative residual of the left-out pixels of so many folds."""
        light = sum(fold.squared_light for fold in self.folds[:folds]) or 1.0
        return float(np.sqrt(fit.error / light))

    @property
    def tried(self) -> tuple[Tried, ...]:
        """All fits to the first fold so far."""
        return tuple(
            Tried(each.width, each.strength, each.iterations, self.residual(each))
            for each in self.done.values()
        )

    def _run(
        self,
        folds: Sequence[Fold],
        width: float,
        strength: float,
        iterations: int,
        to_reach: float = np.inf,
        still: float = STILL_FALLING,
    ) -> Fit:
        """Run some folds, and stop all of them where together they predict best."""
        how = width, strength, iterations, to_reach, still
        runs = [_errors(fold, *how) for fold in folds]
        # a fold that settled earlier stays as it was
        errors = [
            sum(run[min(at, len(run) - 1)] for run in runs) for at in range(max(map(len, runs)))
        ]
        stop = int(np.argmin(errors))
        return Fit(width, strength, CHECKPOINTS[stop], errors[stop])


def _errors(
    fold: Fold, width: float, strength: float, iterations: int, to_reach: float, still: float
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
        enough = min(SETTLED * (fold.squared_light - now), still * now)
        return before - now < enough or now - CATCHING_UP * (before - now) > to_reach

    found = solve_smoothly(
        fold.training,
        fold.training_pixels,
        width=width,
        strength=strength,
        iterations=iterations,
        start=fold.start,
        weights=fold.training_weights,
        callback=evaluate,
    )
    if not errors:  # it converged before the first checkpoint
        volume = fold.training.active.compress(found.volume)
        errors.append(float(fold.squared_errors(volume).sum()))
    return errors
