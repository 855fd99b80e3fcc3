"""Candidates: methods, widths of a smooth basis and strengths, tried on what is left out."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.selection.cross_validation import (
    CHECKPOINTS,
    FEW_VIEWS,
    MULTIPLICATIVE,
    Trial,
    views_to_leave_out,
    weighed,
)
from tomo.solvers.curvature import FIRST
from tomo.solvers.mlem import interleaved

ITERATIONS = {"mlem": 17, "nnls": 40, "tikhonov": 40, "curvature": 40}
"""The most that each candidate is given: Poisson, and least squares without and with a penalty."""

LONGEST = 80
"""The most that least squares with a penalty are given where unknowns have no edges."""

PENALISED = ("tikhonov", "curvature")
"""Methods that take a strength."""

WORTH_WIDENING = 0.1
"""A wider basis must gain so much of what all smoothing has gained: what it gains less is chance,
and detail is lost for it. A stronger penalty loses less, and has to gain anything at all."""

SEGMENTS_A_TRIAL = 2_500_000
PIXELS_AN_UNKNOWN = 8
"""Pixels of larger systems are thinned evenly to about so many crossings while choosing. Where
there are more pixels than unknowns, so many an unknown stay: a system that is no longer
overdetermined would ask for more smoothness than the whole one."""


class Candidate(NamedTuple):
    """A method as it was run, and the relative residual of the left-out views.

    ``strength`` is that of its penalty; None is as faint as suits the unknowns, or no penalty.
    """

    method: str
    width: float
    iterations: int
    held_out_residual: float
    strength: float | None = None


Told = Callable[[int, int, str], None]
"""``progress(done, total, where)``."""


def further_settings(
    method: str,
    projector: ProjectionOperator,
    strength: float | None,
    weights: NDArray[np.float32] | None,
) -> Mapping[str, Any]:
    """Return what a method takes beside its iterations.

    ``weights`` are what pixels are worth to least squares; MLEM knows of photons by itself.
    """
    found: dict[str, Any] = {} if method in MULTIPLICATIVE else {"weights": weights}
    if method in PENALISED:
        found["strength"] = projector.faint if strength is None else strength
    return found


@dataclass(frozen=True)
class Attempt:
    """What a method, so smooth, came to, stopped where what was left out is predicted best.

    ``of_views`` and ``spared`` are squared errors as of `Trial.squared_error`, summed over the
    trials; ``of_trials`` both together for each.
    """

    method: str
    width: float
    iterations: int
    of_views: float
    spared: float
    of_trials: Sequence[float]
    strength: float | None = None

    @property
    def error(self) -> float:
        """Both together: what smoothness and stop are chosen by."""
        return self.of_views + self.spared

    def or_better(self, rival: Attempt | None) -> Sequence[float]:
        """Return the errors of the trials, those of a rival where they are lower."""
        if rival is None:
            return self.of_trials
        return [min(each) for each in zip(self.of_trials, rival.of_trials, strict=True)]


@dataclass(eq=False)
class Candidates:
    """The trials that candidates are judged by, and what was tried.

    ``scale`` is the squared norm that left-out views are judged by.
    """

    trials: Sequence[Trial]
    scale: float
    total: int = 0
    progress: Told | None = None
    tried: list[Candidate] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        views: Sequence[int],
        total: int = 0,
        progress: Told | None = None,
        weights: NDArray[np.float32] | None = None,
    ) -> Candidates:
        """Leave out views, and pixels of the others where views are few; thin large systems.

        ``weights`` are what pixels are worth, to least squares and when they are judged.
        """
        stride = _stride(projector)
        if stride > 1:
            thinned = interleaved(projector.shape[0], stride)[0]
            projector, measured = projector.take(thinned), measured[thinned]
            weights = None if weights is None else weights[thinned]
        sparing = len(views) <= FEW_VIEWS
        trials = [
            Trial.leaving_out(
                left_out, views, projector, measured, sparing=sparing, weights=weights
            )
            for left_out in views_to_leave_out(views)
        ]
        dark = sum(float(trial.dark[0]) for trial in trials)
        scale = dark or norm(weighed(measured, weights)) ** 2
        return cls(trials, max(scale, np.finfo(float).tiny), total, progress)

    @property
    def spare(self) -> bool:
        """Whether pixels of views that are trained on are left out as well."""
        return any(trial.spared.any() for trial in self.trials)

    @property
    def weighted(self) -> bool:
        """Whether pixels are not all worth the same."""
        return any(trial.training_weights is not None for trial in self.trials)

    def attempt(
        self,
        method: str,
        width: float,
        best: Sequence[float] = (),
        *,
        strength: float | None = None,
        iterations: int | None = None,
        to_the_end: bool = False,
    ) -> Attempt:
        """Run a candidate in every trial, and stop it where what was left out is predicted best.

        ``best`` are the errors of another, one a trial; what cannot reach them ends early.
        """
        if self.progress:
            told = f"smoothness {width:g}" if strength is None else f"strength {strength:g}"
            where = f"choosing: {method}, {told}"
            self.progress(len(self.tried), self.total, where)
        training = self.trials[0].training
        patient = method in PENALISED and not training.edged
        most = iterations or (LONGEST if patient else ITERATIONS[method])

        def settings(trial: Trial) -> Mapping[str, Any]:
            further = further_settings(method, training, strength, trial.training_weights)
            return {"iterations": most, **further}

        judging = {
            "after": FIRST if method == "curvature" else 0,
            "patient": patient,
            "to_the_end": to_the_end,
        }
        errors = np.array(  # (trials, checkpoints, 2)
            [
                trial.squared_errors(method, width, settings(trial), rival, **judging)
                for trial, rival in zip(self.trials, best or [0.0] * len(self.trials), strict=True)
            ]
        )
        together = errors.sum(axis=0)
        stop = int(np.argmin(together.sum(axis=1)))
        of_views, spared = together[stop].tolist()
        of_trials = errors[:, stop].sum(axis=1).tolist()
        stopped = CHECKPOINTS[stop]
        found = Attempt(method, width, stopped, of_views, spared, of_trials, strength)
        self.tried.append(self.candidate(found))
        return found

    def smoothed(
        self,
        method: str,
        widths: Sequence[float] = (0.0,),
        rival: Attempt | None = None,
        *,
        strengths: Sequence[float | None] = (None,),
    ) -> list[Attempt]:
        """Try wider bases, or stronger penalties, as long as that helps; return those, best last.

        What cannot reach ``rival``, another method's best, ends early.
        """
        (width, strength), *smoother = itertools.product(widths, strengths)
        reached = rival.of_trials if rival else ()
        helped = [self.attempt(method, width, reached, strength=strength)]
        for width, strength in smoother:
            plain, best = helped[0], helped[-1]
            found = self.attempt(method, width, best.or_better(rival), strength=strength)
            worth = 0.0 if width == best.width else WORTH_WIDENING
            if best.error - found.error <= worth * (plain.error - best.error):
                break
            helped.append(found)
        return helped

    def candidate(self, found: Attempt) -> Candidate:
        """Return an attempt as it is told of."""
        residual = self.residual(found.of_views)
        return Candidate(found.method, found.width, found.iterations, residual, found.strength)

    def residual(self, squared: float) -> float:
        """Return the relative residual of the left-out views."""
        return math.sqrt(squared / self.scale)


def _stride(projector: ProjectionOperator) -> int:
    """Return of how many pixels one takes part while choosing."""
    pixels, unknowns = projector.shape
    wanted = math.ceil(projector.n_segments / SEGMENTS_A_TRIAL)
    if pixels > unknowns:
        wanted = min(wanted, pixels // (PIXELS_AN_UNKNOWN * max(unknowns, 1)))
    return max(wanted, 1)
