"""Explanations of a set of images that compete on pixels that none of them was fitted to.

A `Model` says how pixels come about, ``b = g (A x) + o``: by which rays, seen with which gains and
backgrounds. A `Cause` makes of one model another that explains the same images with one more thing
wrong. `explain` fits the causes to one part of the pixels, compares them on the other, takes the
best where it is clearly better than the model without it, and goes on from there: causes add up.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tomo.operators import Absorption, LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.operators.view_gains import Gains
from tomo.screening.left_out_blocks import Blocks

WORTH = 0.8
"""Fraction of the error beyond noise that may be left for a cause to be taken. Above, causes are
invented that a coarse volume happens to like; below, weak ones are left to spoil the volume."""

SURE = 2.0
"""Standard errors by which a cause must lessen the error. More overlook causes in small images,
fewer take noise for a cause."""

SOLVES = 4
"""Further solves at most of a model before causes are tried on top of it. Causes go on from its
volume: where it has not settled, what more iterations explain looks like a cause."""

TRANSPARENT = Absorption()

QuickSolve = Callable[
    [ProjectionOperator, NDArray[np.float32], NDArray[np.float32] | None], NDArray[np.float32]
]
"""From an operator, its pixels and perhaps a volume to start from to a volume, ``(unknowns,)``."""


@dataclass(frozen=True, eq=False)
class Model:
    """How the pixels of some images come about.

    Attributes
    ----------
    system : LinearSystem
        The rays of all pixels, through the gas that absorbs.
    gains : Gains, optional
        Those of the views; None: all alike, without background.
    absorption : Absorption
    causes : tuple of str
        What the model says is wrong, in the order in which it was found.
    """

    system: LinearSystem
    gains: Gains | None = None
    absorption: Absorption = TRANSPARENT
    causes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model with the volume that it makes of one part of the pixels.

    Attributes
    ----------
    model : Model
    volume : (unknowns,) float32
    errors : (patches,) float64
        Squared errors of the pixels left out, by patch of an image.
    """

    model: Model
    volume: NDArray[np.float32]
    errors: NDArray[np.float64]

    @property
    def error(self) -> float:
        """The sum of the errors."""
        return float(self.errors.sum())


@dataclass(frozen=True, eq=False)
class Evidence:
    """Measured pixels, those that models are fitted to, and those that they are compared on.

    Attributes
    ----------
    measured : (pixels,) float32
    blocks : Blocks
        Which pixels are left out.
    variance : (pixels,) float64
        That of the noise.
    solve : callable
        See `QuickSolve`.
    """

    measured: NDArray[np.float32]
    blocks: Blocks
    variance: NDArray[np.float64]
    solve: QuickSolve

    @cached_property
    def noise(self) -> float:
        """The squared error that the noise of the pixels left out makes by itself."""
        return self.blocks.noise(self.variance)

    @property
    def of_all_pixels(self) -> Evidence:
        """The same with models fitted to all pixels: for one that is taken, not for comparing."""
        everything = replace(self.blocks, training=np.arange(len(self.measured)))
        return replace(self, blocks=everything)

    def fit(self, model: Model, start: NDArray[np.float32] | None = None) -> Fitted:
        """Solve for the volume of a model from one part of the pixels, and predict the other."""
        projector, training = model.system.projector, self.blocks.training
        part = projector.take(training)
        measured = self.measured
        if model.gains is not None:
            measured = model.gains.correct(projector, measured)
        volume = self.solve(part, measured[training], start)
        return Fitted(model, volume, self.blocks.squared_errors(self._misfit(model, volume)))

    def settled(self, fitted: Fitted) -> Fitted:
        """Return the fit after further solves, as long as each lessens the error."""
        for _ in range(SOLVES):
            again = self.fit(fitted.model, fitted.volume)
            if again.error >= fitted.error:
                break
            fitted = again
        return fitted

    def beyond_noise(self, fitted: Fitted) -> float:
        """Return the squared error that noise does not explain."""
        return max(fitted.error - self.noise, 0.0)

    def worth(self, before: Fitted, after: Fitted) -> float:
        """Return the fraction of the error beyond noise that is left; 1 where nothing is sure.

        Sure is what exceeds the standard error of the patches' differences, in which all that
        neither explains cancels, or that of what is left, where a few patches make the difference.
        """
        less = before.errors - after.errors
        spread = np.sqrt(len(less)) * float(min(less.std(), after.errors.std()))
        if before.error - after.error <= SURE * spread or self.beyond_noise(before) == 0:
            return 1.0
        return self.beyond_noise(after) / self.beyond_noise(before)

    def _misfit(self, model: Model, volume: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return measured less predicted of the pixels left out, in the units of the images."""
        projector, left_out = model.system.projector, self.blocks.left_out
        part = projector.take(left_out)
        predicted = part @ volume
        if model.gains is not None:
            predicted = model.gains.apply(part, predicted)
        return self.measured[left_out].astype(np.float64) - predicted


class Cause(Protocol):
    """One thing that may be wrong with a set of images."""

    @property
    def name(self) -> str:
        """Its name, as reports have it."""

    @property
    def worth(self) -> float:
        """Fraction of the error beyond noise that it may leave to be taken; see `WORTH`."""

    def fit(self, fitted: Fitted, evidence: Evidence) -> Sequence[Fitted]:
        """Return what it makes of a model, the best one last; empty where it explains nothing."""


@dataclass(frozen=True)
class Trial:
    """One cause on top of others: what it left unexplained.

    Attributes
    ----------
    causes : tuple of str
        In the order in which they were taken, the one tried last.
    error : float
        The squared error of pixels left out that noise does not explain, over that of the images
        as given.
    """

    causes: tuple[str, ...]
    error: float


@dataclass(frozen=True, eq=False)
class Explained:
    """The model that the images ask for, and what else was tried.

    Attributes
    ----------
    as_given, best : Fitted
    trials : tuple of Trial
    noise : float
        The squared error that noise makes by itself over that of the images as given.
    refused : tuple of Fitted
        Models with one more cause than the best that surely lessen the error, but by too little.
    """

    as_given: Fitted
    best: Fitted
    trials: tuple[Trial, ...]
    noise: float
    refused: tuple[Fitted, ...] = ()

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "causes": list(self.best.model.causes),
            "tried": [{"causes": list(one.causes), "error": one.error} for one in self.trials],
            "noise": self.noise,
        }


def explain(
    model: Model, causes: Sequence[Cause], evidence: Evidence, asked: Collection[str] = ()
) -> Explained:
    """Return the simplest model that explains the images clearly better than simpler ones.

    Parameters
    ----------
    model : Model
        Of images as given.
    causes : sequence of Cause
    evidence : Evidence
    asked : collection of str
        Causes that are taken wherever they lessen the error at all.

    Notes
    -----
    The cause is taken that leaves least of the error, if that is worth taking; the others are
    then tried on top of it, with what it explained gone, until none is worth taking. None is
    taken before all were tried.
    """
    given = best = evidence.settled(evidence.fit(model))
    unit = max(evidence.beyond_noise(given), np.finfo(np.float64).tiny)
    trials, left, refused = [], list(causes), []
    while left:
        tried = []
        for cause in left:
            for fitted in cause.fit(best, evidence)[-1:]:
                tried.append((cause, fitted))
                error = evidence.beyond_noise(fitted) / unit
                trials.append(Trial((*best.model.causes, cause.name), error))
        worth = [
            (cause, fitted)
            for cause, fitted in tried
            if evidence.worth(best, fitted) < cause.worth
            or (cause.name in asked and fitted.error < best.error)
        ]
        refused = [fitted for _, fitted in tried if evidence.worth(best, fitted) < 1]
        if not worth:
            break
        taken, best = min(worth, key=lambda pair: pair[1].error)
        best, refused = evidence.settled(best), []
        left.remove(taken)
    share = evidence.noise / (given.error or 1.0)
    return Explained(given, best, tuple(trials), share, tuple(refused))
