"""Scores: how far one step of every effect exceeds what exact cameras make of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit  # scipy.stats has both, and takes 0.3 s to load

from tomo.grid import ActiveVoxels
from tomo.inference.state import HIDDEN, OUTSIDE, State
from tomo.inference.steps import DETAIL, DRAWN, Null, Steps
from tomo.model.effect import Effect
from tomo.model.observation import Observation

FALSE_ALARMS = 0.02
"""Probability that anything is said of a faultless scene."""

NEGLIGIBLE = 0.1
"""Size of an effect, in standard deviations of its prior, that voxels may always explain."""

FIELD = "field"

LEAST = {OUTSIDE: 0.001, HIDDEN: 0.002, FIELD: 0.0005}
"""The same for light from outside, a fraction of all; for pixels that nothing explains; and for
the mean of a field, in its standard deviations: larger, faint clouds stay."""


class Scores:
    """The scores of one scene, with the null that they are compared with and the limits.

    With ``look_outside`` light may come from around the grid.

    Attributes
    ----------
    deviation : mapping of str to (views, parameters)
        Of each effect's prior.
    own_limit, shared_limit : float
        Scores from which effects of single views, and those that views share, are no chance.
    bias : mapping of str to float
        The null's mean of effects that views share.
    spread : mapping of str to (parameters,)
        The null's spread of those that were compared with it.
    highest : mapping of str to (views,)
        The highest scores over their limits so far.
    null : Null, optional
        What the steps are compared with; None before it is drawn.
    """

    def __init__(
        self,
        observation: Observation,
        effects: Sequence[Effect],
        active: ActiveVoxels | None,
        look_outside: bool,
    ) -> None:
        self.effects, self.active, self.look_outside = effects, active, look_outside
        self.deviation = {e.name: e.deviation(observation) for e in effects}
        views = len(observation.rig)
        own = sum(self.deviation[e.name].size for e in effects if not e.shared)
        shared = 1 + sum(e.shared for e in effects)
        self.own_limit = float(-stdtrit(DRAWN * views, FALSE_ALARMS / 4 / (own + views)))
        self.shared_limit = float(-ndtri(FALSE_ALARMS / 2 / shared))
        self.null: Null | None = None
        self.bias: dict[str, float] = {}
        self.spread: dict[str, NDArray[np.float64]] = {}
        self.highest: dict[str, NDArray[np.float64]] = {}

    def _null_of(self, steps: Steps) -> Null:
        """Return the null of the first fits; it is drawn when something may exceed it."""
        if self.null is None:
            self.null = Null(steps, self.active)
        return self.null

    def spread_of(self, name: str, steps: Steps, draw: bool) -> NDArray[np.float64]:
        """Return what exact cameras make of an effect of single views, ``(parameters,)``.

        Where no effect asked for the null so far, and none is to ``draw`` it, the steps of the
        scene itself are no more than chance, and stand for it.
        """
        if self.null is None and not draw:
            return (1 + DETAIL) * np.sqrt(np.square(steps.own[name]).mean(axis=0))
        return self._null_of(steps).spread(name)

    def shared_null(self, effect: Effect, steps: Steps) -> tuple[float, float]:
        """Return mean and spread of what exact cameras make of an effect that views share."""
        return self._null_of(steps).of(lambda one: one.shared(effect))

    def ratios(
        self, state: State, tell: Callable[[int, str], None] = lambda done, where: None
    ) -> dict[str, NDArray[np.float64]]:
        """Return each effect's score over its limit by view, 0 where it is loose already.

        ``tell`` is told how many effects are compared, and the next one's name.
        """
        steps, views = Steps(state.fits, self.effects, state.values), len(state.hidden)
        found: dict[str, NDArray[np.float64]] = {}
        for number, effect in enumerate(self.effects):
            name, least = effect.name, self.least(effect)
            tell(number, name)
            if state.free[name].all() or (effect.shared and state.has_outside):
                found[name] = np.zeros(views)  # its null has no light around the grid
            elif effect.shared:
                found[name] = np.full(views, self._shared(steps, effect, least[0, 0]))
            else:
                size = steps.own[name]
                size = np.maximum(size, 0) if effect.positive else np.abs(size)
                spread = np.zeros(least.shape[1])
                if (size > self.own_limit * least).any():
                    spread = self.spread[name] = self._null_of(steps).spread(name)
                score = np.where(state.free[name], 0, size / np.hypot(spread, least))
                found[name] = score.max(axis=1) / self.own_limit
        found[OUTSIDE] = np.zeros(views)
        if self.look_outside and not state.has_outside and not state.is_dark_around:
            found[OUTSIDE][:] = self._outside(steps)
        found[HIDDEN] = np.where(state.hidden, 0, self._hidden(steps))
        if (found[HIDDEN] >= 1).mean() > 0.5:  # what most views show is no hardware before one
            found[HIDDEN][:] = 0
        taking_part = [state.takes_part(view) for view in range(views)]
        for name, ratio in found.items():
            ratio *= taking_part
            self.highest[name] = np.maximum(self.highest.get(name, 0), ratio)
        return found

    def least(self, effect: Effect) -> NDArray[np.float64]:
        """Return the sizes that are never distinguished from voxels, ``(views, parameters)``."""
        deviation = self.deviation[effect.name]
        if effect.field_of is not None:
            return np.full_like(deviation, LEAST[FIELD])
        return NEGLIGIBLE * deviation

    def _shared(self, steps: Steps, effect: Effect, least: float) -> float:
        """Return the score over its limit of an effect that all views share."""
        value = steps.shared(effect)
        if value <= 0:  # the wrong sign is no evidence, whatever the null
            return 0.0
        if effect.field_of is not None and value <= self.shared_limit * least:
            return 0.0  # the null, which is never below zero, need not be drawn
        mean, spread = self.shared_null(effect, steps)
        self.bias[effect.name], self.spread[effect.name] = mean, np.array([spread])
        return (value - mean) / float(np.hypot(spread, least)) / self.shared_limit

    def _outside(self, steps: Steps) -> float:
        least = LEAST[OUTSIDE]
        if steps.outside <= self.shared_limit * least:
            return 0.0
        mean, spread = self._null_of(steps).of(lambda one: one.outside)
        return (steps.outside - mean) / float(np.hypot(spread, least)) / self.shared_limit

    def _hidden(self, steps: Steps) -> NDArray[np.float64]:
        hidden, few = steps.hidden, LEAST[HIDDEN]
        may = (hidden > self.own_limit * few).any()
        often = self._null_of(steps).hidden() if may else 0.0
        return hidden / np.hypot(often, few) / self.own_limit
