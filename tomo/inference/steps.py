"""One step of every effect from a fit, and what the same steps come to on the null."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.inference.fit import Fit, Values, first_fit, next_fit, with_surroundings
from tomo.inference.null import exact_images
from tomo.model.effect import Effect
from tomo.model.gauge import without_gauge

DRAWN = 3
"""Scenes of the null. Fewer: the spread of what all views share is not known; more take longer."""

DETAIL = 0.3
"""Relative error of what the null comes to: its volumes have less detail than the flame."""


class Steps:
    """One step of every effect from a fit, each found when it is asked for.

    Parameters
    ----------
    fit : Fit
    effects : sequence of Effect
    values : mapping
        What was corrected already: priors hold for the sum.
    """

    def __init__(self, fit: Fit, effects: Sequence[Effect], values: Values) -> None:
        self.fit, self.effects, self.values = fit, effects, values
        self._shared: dict[str, float] = {}

    @cached_property
    def _together(self) -> Fit:
        own = [effect for effect in self.effects if not effect.shared]
        return next_fit(self.fit, own, values=self.values)

    @cached_property
    def own(self) -> Values:
        """Steps of what each view has for itself, all together, without the gauge."""
        found = self._together.values
        return without_gauge(found, self.fit.observation, self.fit.means)

    @property
    def misfit(self) -> float:
        """Root mean square of the residual that these steps leave."""
        fit = self._together
        return float(np.sqrt(np.average(fit.residual**2, weights=fit.trust + 1e-12)))

    def shared(self, effect: Effect) -> float:
        """Return the step of an effect that all views share, let loose alone."""
        if effect.name not in self._shared:
            found = next_fit(self.fit, (effect,), values=self.values).values
            self._shared[effect.name] = float(found[effect.name][0, 0])
        return self._shared[effect.name]

    @cached_property
    def outside(self) -> float:
        """The fraction of all light that voxels around the grid explain."""
        return next_fit(with_surroundings(self.fit)).light_outside

    @property
    def hidden(self) -> NDArray[np.float64]:
        """The fraction of every view's pixels that lost their weight, ``(views,)``."""
        return distrust(self.fit)


class Null:
    """Steps on scenes like the one found, seen by exact cameras through the known gas.

    Parameters
    ----------
    steps : Steps
        Those of the scene itself.
    active : ActiveVoxels, optional
    """

    def __init__(self, steps: Steps, active: ActiveVoxels | None) -> None:
        fit, effects = steps.fit, steps.effects
        views = len(fit.observation.rig)
        none = {e.name: np.zeros((views, len(e.parameters))) for e in effects}
        self._drawn = []
        for turn in range(DRAWN):
            made = exact_images(fit.observation, fit.means, turn, active)
            same = made[1] is active and not fit.observation.absorption.emission
            system = fit.system if same else None
            drawn = first_fit(*made, rounds=1, system=system)
            self._drawn.append(Steps(drawn, effects, none))
        misfit = float(np.mean([one.misfit for one in self._drawn]))
        self._factor = (1 + DETAIL) * max(1.0, steps.misfit / max(misfit, 1e-300)) ** 0.5

    def spread(self, name: str) -> NDArray[np.float64]:
        """Return the spread of what each view has for itself, ``(parameters,)``.

        It is larger where the scene's residual is: by the root of the ratio, since a part of
        it is detail that no voxel shows, and a part the faults that are looked for.
        """
        squares = [np.square(one.own[name]).mean(axis=0) for one in self._drawn]
        return self._factor * np.sqrt(np.mean(squares, axis=0))

    def hidden(self) -> float:
        """Return the spread of the fraction of pixels that lost their weight."""
        return float(np.sqrt(np.mean([np.square(one.hidden) for one in self._drawn])))

    def of(self, what: Callable[[Steps], float]) -> tuple[float, float]:
        """Return mean and spread of what all views share."""
        drawn = [what(one) for one in self._drawn]
        mean = float(np.mean(drawn))
        return mean, float(np.hypot(np.std(drawn, ddof=1), DETAIL * mean))


def distrust(fit: Fit, lit: float = -np.inf) -> NDArray[np.float64]:
    """Return the fraction of every view's usable pixels that lost their weight, ``(views,)``.

    Those count that are as bright as ``lit``, measured or predicted.
    """
    ptr = fit.system.projector.view_ptr
    bright = np.maximum(fit.measured, fit.measured - fit.residual) >= lit
    counted = fit.usable & bright

    def sums(values: NDArray) -> NDArray[np.float64]:
        return np.diff(np.r_[0.0, np.cumsum(np.where(counted, values, 0.0))][ptr])

    return sums(1 - fit.trust) / np.maximum(sums(np.ones(len(bright))), 1)
