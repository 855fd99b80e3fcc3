"""Effects found beside the voxels, one at a time, as far as they exceed what exact cameras make.

Detection, identification, adaptation: all effects are scored from one fit, the largest is let
loose and found together with the voxels, and all are scored again, until none exceeds its null.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.stats import norm
from scipy.stats import t as student

from tomo.grid import ActiveVoxels
from tomo.inference.fit import (
    TRUSTED,
    Fit,
    Values,
    continued,
    first_fit,
    next_fit,
    scale_of,
    smoothed,
    with_surroundings,
    with_trust,
)
from tomo.inference.left_out import surely_worse
from tomo.inference.steps import DRAWN, Null, Steps
from tomo.model.effect import Effect
from tomo.model.gauge import without_gauge
from tomo.model.observation import Observation

FALSE_ALARMS = 0.02
"""Probability that anything is said of a faultless scene."""

NEGLIGIBLE = 0.1
"""Size of an effect, in standard deviations of its prior, that is never told from voxels."""

OUTSIDE, HIDDEN = "outside", "hidden"
ALL = -1
"""Stands for all views."""

LEAST = {OUTSIDE: 0.001, HIDDEN: 0.002}
"""The same for light from outside, a fraction of all, and for pixels that nothing explains."""

PLAUSIBLE = 4.0
"""Standard deviations of its prior that gas and fall-off have at most: beyond, they explain what
no voxel can."""

ROUNDS = 8
"""Effects that are let loose, one after the other. More take longer where cameras all err."""

STEPS = 8
"""Gauss-Newton steps of an effect at most; they end when none is larger than `NEGLIGIBLE`."""

RIVAL = 0.5
"""Score over its limit from which an effect competes for a view that something is wrong with."""

ALIKE = 0.9
"""Cost of light from around the grid over that of backgrounds, below which it is taken: voxels
around the grid explain an even background as well, with many more unknowns."""

TRIED = 3
"""Gauss-Newton steps of an effect that others compete with: fewer stop far from large faults."""

WIDER = 2
"""Pixels around those that nothing explains that are not trusted either."""

INDEPENDENT = 12.6
"""Pixels that a smoothed residual is the mean of: 4 pi squared standard deviations."""


@dataclass(frozen=True, eq=False)
class State:
    """How far the inference came.

    Attributes
    ----------
    fit : Fit
    values : mapping of str to (views, parameters)
        Of the effects so far.
    free : mapping of str to (views, parameters) bool
        Those that were let loose.
    hidden : (views,) bool
        The views of which pixels are left out that nothing explains.
    is_dark_around : bool
        Whether backgrounds explain what light from around the grid would.
    """

    fit: Fit
    values: Values
    free: dict[str, NDArray[np.bool_]]
    hidden: NDArray[np.bool_]
    is_dark_around: bool = False


@dataclass(frozen=True, eq=False)
class Inference:
    """What was found beside the voxels.

    Attributes
    ----------
    observation : Observation
        As it was looked at.
    effects : tuple of Effect
    state : State
    scores : mapping of str to (views,) float64
        How far each effect of each view exceeded its null when it was let loose, or at the end: 1
        is the limit.
    spread : mapping of str to (parameters,) float64
        What exact cameras make of each effect that was tested against the null.
    """

    observation: Observation
    effects: tuple[Effect, ...]
    state: State
    scores: dict[str, NDArray[np.float64]]
    spread: dict[str, NDArray[np.float64]]

    @property
    def has_outside(self) -> bool:
        """Whether light from around the grid was found."""
        return self.state.fit.around is not None


def infer(
    observation: Observation,
    effects: Sequence[Effect],
    active: ActiveVoxels | None = None,
    asked: Sequence[str] = (),
    look_outside: bool = True,
    first: Fit | None = None,
) -> Inference:
    """Return the effects that exceed their null, found together with the voxels.

    Parameters
    ----------
    observation : Observation
        A coarse copy will do.
    effects : sequence of Effect
    active : ActiveVoxels, optional
        The voxels that dark pixels do not prove empty.
    asked : sequence of str
        Effects that are let loose whatever their score.
    look_outside : bool
        Whether light may come from around the grid.
    first : Fit, optional
        See `tomo.inference.fit.first_fit`, where it is known.
    """
    views = len(observation.rig)
    none = {e.name: np.zeros((views, len(e.parameters))) for e in effects}
    free = {n: np.full(v.shape, n in asked) for n, v in none.items()}
    first = first or first_fit(observation, active)
    state = State(first, none, free, np.zeros(views, bool))
    search = _Search(observation, tuple(effects), active, look_outside)
    if asked:
        state = search.relaxed(state)
    given = state
    for _ in range(ROUNDS):
        ratio = search.ratios(state)
        if max(float(one.max()) for one in ratio.values()) < 1:
            break
        state = search.adapted(state, ratio)
    if state is not given:
        state = search.pruned(state, asked)
    if state is not given and surely_worse(state.fit, given.fit):
        state = given
    return Inference(observation, tuple(effects), state, search.highest, search.spread)


class _Search:
    """What the rounds of an inference share: the observation, its null, and the limits."""

    def __init__(
        self,
        observation: Observation,
        effects: tuple[Effect, ...],
        active: ActiveVoxels | None,
        look_outside: bool,
    ) -> None:
        self.observation, self.effects, self.active = observation, effects, active
        self.look_outside = look_outside
        self.deviation = {e.name: e.deviation(observation) for e in effects}
        views = len(observation.rig)
        own = sum(self.deviation[e.name].size for e in effects if not e.shared)
        shared = 1 + sum(e.shared for e in effects)
        self.own_limit = float(student.isf(FALSE_ALARMS / 4 / (own + views), DRAWN * views))
        self.shared_limit = float(norm.isf(FALSE_ALARMS / 2 / shared))
        self._null: Null | None = None
        self.bias: dict[str, float] = {}
        self.highest: dict[str, NDArray[np.float64]] = {}
        self.spread: dict[str, NDArray[np.float64]] = {}

    def null(self, steps: Steps) -> Null:
        """Return the null of the first fit; it is drawn when something may exceed it."""
        if self._null is None:
            self._null = Null(steps, self.active)
        return self._null

    def ratios(self, state: State) -> dict[str, NDArray[np.float64]]:
        """Return each effect's score over its limit by view, 0 where it is loose already."""
        steps, views = Steps(state.fit, self.effects, state.values), len(state.hidden)
        found: dict[str, NDArray[np.float64]] = {}
        for effect in self.effects:
            name, least = effect.name, NEGLIGIBLE * self.deviation[effect.name]
            if state.free[name].all() or (effect.shared and state.fit.around is not None):
                found[name] = np.zeros(views)  # its null has no light around the grid
            elif effect.shared:
                found[name] = np.full(views, self._shared(steps, effect, least[0, 0]))
            else:
                size = steps.own[name]
                size = np.maximum(size, 0) if effect.positive else np.abs(size)
                spread = np.zeros(least.shape[1])
                if (size > self.own_limit * least).any():
                    spread = self.spread[name] = self.null(steps).spread(name)
                score = np.where(state.free[name], 0, size / np.hypot(spread, least))
                found[name] = score.max(axis=1) / self.own_limit
        found[OUTSIDE] = np.zeros(views)
        if self.look_outside and state.fit.around is None and not state.is_dark_around:
            found[OUTSIDE][:] = self._outside(steps)
        hidden, few = steps.hidden, LEAST[HIDDEN]
        often = self.null(steps).hidden() if (hidden > self.own_limit * few).any() else 0.0
        found[HIDDEN] = np.where(state.hidden, 0, hidden / np.hypot(often, few))
        found[HIDDEN] /= self.own_limit
        if (found[HIDDEN] >= 1).mean() > 0.5:  # what most views show is no hardware before one
            found[HIDDEN][:] = 0
        for name, ratio in found.items():
            self.highest[name] = np.maximum(self.highest.get(name, 0), ratio)
        return found

    def _shared(self, steps: Steps, effect: Effect, least: float) -> float:
        """Return the score over its limit of an effect that all views share."""
        value = steps.shared(effect)
        if value <= 0:  # the wrong sign is no evidence, whatever the null
            return 0.0
        mean, spread = self.null(steps).of(lambda one: one.shared(effect))
        self.bias[effect.name], self.spread[effect.name] = mean, np.array([spread])
        return (value - mean) / float(np.hypot(spread, least)) / self.shared_limit

    def _outside(self, steps: Steps) -> float:
        least = LEAST[OUTSIDE]
        if steps.outside <= self.shared_limit * least:
            return 0.0
        mean, spread = self.null(steps).of(lambda one: one.outside)
        return (steps.outside - mean) / float(np.hypot(spread, least)) / self.shared_limit

    def adapted(self, state: State, ratio: Mapping[str, NDArray[np.float64]]) -> State:
        """Return the state with what explains the view better that exceeds its null most.

        An effect of most views is let loose in all of them. It competes with what may be wrong
        with the most doubtful single view: the effects that exceed their null there, and leaving
        out the pixels that lost their weight. What explains most, for its prior, is taken.
        """
        largest = {name: float(one.max()) for name, one in ratio.items()}
        if largest[OUTSIDE] >= max(largest.values()):
            return self._around(state)
        worst = max((n for n in largest if n != OUTSIDE), key=largest.__getitem__)
        trials = {}
        if worst != HIDDEN and (ratio[worst] >= 1).mean() > 0.5:
            trials[worst, ALL] = self._loose(state, worst, np.full(len(state.hidden), True))
        own = {e.name for e in self.effects if not e.shared}
        single = {n: ratio[n] for n in (own | {HIDDEN}) - ({worst} if trials else set())}
        most = max(single, key=lambda name: (single[name].max(), name))
        view = int(np.argmax(single[most]))
        if not trials or single[most][view] >= 1:
            only = np.arange(len(state.hidden)) == view
            for name in sorted(own):
                if single.get(name, np.zeros(len(only)))[view] >= RIVAL:
                    trials[name, view] = self._loose(state, name, only)
        tried = {key: self.relaxed(trial, TRIED) for key, trial in trials.items()}
        if HIDDEN in single and single[HIDDEN][view] >= RIVAL and (tried or most == HIDDEN):
            tried[HIDDEN, view] = self.without_hidden(state, np.arange(len(state.hidden)) == view)
        scale = min(_scale(one.fit) for one in tried.values())
        cost = {key: self._cost(one, scale) for key, one in tried.items()}
        least = min(cost, key=cost.__getitem__)
        return tried[least] if least[0] == HIDDEN else self.relaxed(tried[least])

    def pruned(self, state: State, asked: Sequence[str]) -> State:
        """Return the state without effects that are far below their limits once all are found."""
        free, values = {}, {}
        for effect in self.effects:
            name, value = effect.name, state.values[effect.name]
            limit = self.shared_limit if effect.shared else self.own_limit
            spread = np.hypot(self.spread.get(name, 0.0), NEGLIGIBLE * self.deviation[name])
            far = np.abs(value) > RIVAL * limit * spread
            most = state.free[name].any(axis=1).mean() > 0.5  # found from all of them together
            kept = name in asked or (most and not effect.shared)
            real = far.any(axis=1, keepdims=True) | kept
            free[name], values[name] = state.free[name] & real, np.where(real, value, 0.0)
        if all(np.array_equal(free[n], state.free[n]) for n in free):
            return state
        seen = corrected(self.observation, self.effects, values)
        fit = with_trust(next_fit(continued(state.fit, seen, self.active)))
        return self.relaxed(replace(state, fit=fit, values=values, free=free))

    def _around(self, state: State) -> State:
        """Return the state with light from around the grid, or with backgrounds if these do."""
        around = self.relaxed(replace(state, fit=with_surroundings(state.fit)))
        if "background" not in self.deviation:
            return around
        level = self.relaxed(self._loose(state, "background", np.full(len(state.hidden), True)))
        scale = min(_scale(around.fit), _scale(level.fit))
        cost = [self._cost(one, scale) for one in (around, level)]
        return around if cost[0] < ALIKE * cost[1] else replace(level, is_dark_around=True)

    def _loose(self, state: State, name: str, views: NDArray[np.bool_]) -> State:
        """Return the state with an effect let loose, all usable pixels of its views trusted."""
        free = {n: f.copy() for n, f in state.free.items()}
        free[name] |= views[:, None]
        return replace(state, free=free, fit=_trusting(state.fit, views))

    def _prior(self, values: Values) -> float:
        return sum(float(np.square(v / self.deviation[n]).sum()) for n, v in values.items())

    def without_hidden(self, state: State, views: NDArray[np.bool_]) -> State:
        """Return the state without the pixels of some views that lost their weight."""
        fit = state.fit
        lost = fit.system.images((fit.trust < 0.5).astype(np.float32))
        wide = [
            binary_dilation(image > 0, iterations=WIDER).astype(np.float32) * view
            for image, view in zip(lost, views, strict=True)
        ]
        fit = replace(fit, usable=fit.usable & ~(fit.system.flatten(wide) > 0))
        for _ in range(2):
            fit = with_trust(next_fit(fit))
        return replace(state, fit=fit, hidden=state.hidden | views)

    def relaxed(self, state: State, steps: int = STEPS) -> State:
        """Return the state after Gauss-Newton steps of all that is loose, while they help."""
        scale = _scale(state.fit)
        best, least = state, np.inf  # the first step may cost more before others cost less
        for _ in range(steps):
            state, size = self._stepped(state)
            cost = self._cost(state, scale)
            if cost > least:
                break
            best, least = state, cost
            if size < NEGLIGIBLE:
                break
        return best

    def _cost(self, state: State, scale: float) -> float:
        """Return the bounded misfit of a state, and what its effects cost by their priors."""
        return _disagreement(state.fit, scale) + self._prior(state.values)

    def _stepped(self, state: State) -> tuple[State, float]:
        """Return the state after one step, and the largest change in deviations of its prior."""
        values = state.values
        step = next_fit(state.fit, self.effects, free=state.free, values=values)
        moved = {}
        for effect in self.effects:
            change = step.values[effect.name]
            if effect.shared and change.any():  # to where one more step is the null's
                change = change - self.bias.get(effect.name, 0.0)
            most = PLAUSIBLE * self.deviation[effect.name] if effect.shared else np.inf
            moved[effect.name] = np.minimum(values[effect.name] + change, most)
        moved = without_gauge(moved, self.observation, step.means, state.free)
        for effect in self.effects:
            if effect.positive:
                moved[effect.name] = np.maximum(moved[effect.name], 0)
        sizes = [np.abs((moved[n] - values[n]) / self.deviation[n]).max() for n in moved]
        seen = corrected(self.observation, self.effects, moved)
        fit = with_trust(next_fit(continued(step, seen, self.active)))
        return replace(state, fit=fit, values=moved), float(max(sizes))


def corrected(observation: Observation, effects: Sequence[Effect], values: Values) -> Observation:
    """Return the observation without the effects."""
    for effect in effects:
        if values[effect.name].any():
            observation = effect.applied(observation, values[effect.name])
    return observation


def _trusting(fit: Fit, views: NDArray[np.bool_]) -> Fit:
    """Return the fit with all usable pixels of some views trusted again."""
    of_view = np.repeat(views, np.diff(fit.system.projector.view_ptr))
    return replace(fit, trust=np.where(of_view & fit.usable, 1.0, fit.trust))


def _scale(fit: Fit) -> float:
    return scale_of(fit, smoothed(fit))


def _disagreement(fit: Fit, scale: float) -> float:
    """Return the bounded sum of squared smoothed residuals, in independent pixels."""
    squares = np.square(smoothed(fit) / scale)
    bounded = np.where(fit.usable, squares / (1 + squares / TRUSTED**2), TRUSTED**2)
    return float(bounded.sum()) / INDEPENDENT
