"""Adaptation: what explains best is let loose, and found together with the voxels."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from tomo.grid import ActiveVoxels
from tomo.inference.fit import Fit, continued
from tomo.inference.scores import NEGLIGIBLE, Scores
from tomo.inference.solve import Values, next_fit, next_fits
from tomo.inference.state import HIDDEN, OUTSIDE, State, corrected
from tomo.inference.steps import mean_volume, sizes_of
from tomo.model.effect import Effect
from tomo.model.gauge import without_gauge
from tomo.model.observation import Observation

PLAUSIBLE = 4.0
"""Standard deviations of its prior that gas and fall-off have at most: beyond, they explain what
no voxel can."""

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


class Adaptation:
    """How effects are let loose.

    ``observations`` are one a frame, as recorded. Effects that are ``held`` were let loose in
    some views for the asking: the others hold the scene.
    """

    def __init__(
        self,
        observations: Sequence[Observation],
        effects: Sequence[Effect],
        active: ActiveVoxels | None,
        scores: Scores,
        held: Collection[str] = (),
    ) -> None:
        self.observations, self.effects, self.active = observations, effects, active
        self.scores, self.deviation, self.held = scores, scores.deviation, held

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
        gas = {effect.name for effect in self.effects if effect.of_gas}
        trials: dict[tuple[str, int | None], State] = {}  # None: all views
        for name in sorted({worst, *gas} - {HIDDEN}):
            if (ratio[name] >= 1).mean() > 0.5:
                trials[name, None] = self._loosened(state, name)
        own = {e.name for e in self.effects if not e.shared}
        single = {n: ratio[n] for n in (own | {HIDDEN}) - ({worst} if trials else set())}
        most = max(single, key=lambda name: (single[name].max(), name))
        view = int(np.argmax(single[most]))
        if not trials or single[most][view] >= 1:
            only = np.arange(len(state.hidden)) == view
            for name in sorted(own):
                if single.get(name, np.zeros(len(only)))[view] >= RIVAL:
                    trials[name, view] = state.loosened(name, only)
        tried = {key: self.relaxed(trial, TRIED) for key, trial in trials.items()}
        if HIDDEN in single and single[HIDDEN][view] >= RIVAL and (tried or most == HIDDEN):
            tried[HIDDEN, view] = _without_hidden(state, np.arange(len(state.hidden)) == view)
        scales = np.min([one.scales for one in tried.values()], axis=0)
        cost = {key: one.cost(scales, self.effects, self.deviation) for key, one in tried.items()}
        least = min(cost, key=cost.__getitem__)
        return tried[least] if least[0] == HIDDEN else self.relaxed(tried[least])

    def _loosened(self, state: State, name: str) -> State:
        """Return the state with an effect let loose in all views, a field with its even part."""
        every = np.full(len(state.hidden), True)
        for effect in self.effects:
            even = effect.field_of if effect.name == name else None
            if even is not None and even in state.free:
                state = state.loosened(even, every)
        return state.loosened(name, every)

    def _around(self, state: State) -> State:
        """Return the state with light from around the grid, or with backgrounds if these do."""
        fits = tuple(fit.with_surroundings() for fit in state.fits)
        around = self.relaxed(replace(state, fits=fits))
        if "background" not in self.deviation:
            return around
        level = self.relaxed(state.loosened("background", np.full(len(state.hidden), True)))
        scales = np.minimum(around.scales, level.scales)
        cost = [one.cost(scales, self.effects, self.deviation) for one in (around, level)]
        return around if cost[0] < ALIKE * cost[1] else replace(level, is_dark_around=True)

    def pruned(self, state: State, asked: Mapping[str, NDArray[np.bool_]]) -> State:
        """Return the state without effects that are far below their limits once all are found.

        Those stay that were ``asked`` for, by name and view.
        """
        free, scores = {}, self.scores
        for effect in self.effects:
            name, value = effect.name, state.values[effect.name]
            limit = scores.shared_limit if effect.shared else scores.own_limit
            spread = np.hypot(scores.spread.get(name, 0.0), scores.least(effect))
            size = sizes_of(effect, value, self.deviation[name])
            far = np.abs(size) > RIVAL * limit * spread
            most = state.free[name].any(axis=1).mean() > 0.5  # found from all of them together
            kept = asked[name] | (most and not effect.shared)
            free[name] = state.free[name] & (far.any(axis=1) | kept)[:, None]
        if all(np.array_equal(free[n], state.free[n]) for n in free):
            return state
        return self._only(free, state)

    def without_effect(self, state: State, name: str) -> State:
        """Return the state without an effect."""
        return self._only({**state.free, name: np.zeros_like(state.free[name])}, state)

    def _only(self, free: Mapping[str, NDArray[np.bool_]], state: State) -> State:
        """Return the state with only these effects loose, found anew."""
        values = {name: np.where(free[name], one, 0.0) for name, one in state.values.items()}
        fits = self._seen_again(state.fits, values)
        return self.relaxed(replace(state, fits=fits, values=values, free=free))

    def relaxed(self, state: State, steps: int = STEPS) -> State:
        """Return the state after Gauss-Newton steps of all that is loose, while they help."""
        scales = state.scales
        best, least = state, np.inf  # the first step may cost more before others cost less
        for _ in range(steps):
            state, size = self._stepped(state)
            cost = state.cost(scales, self.effects, self.deviation)
            if cost > least:
                break
            best, least = state, cost
            if size < NEGLIGIBLE:
                break
        return best

    def _stepped(self, state: State) -> tuple[State, float]:
        """Return the state after one step, and the largest change in deviations of its prior."""
        values = state.values
        fits, step = next_fits(state.fits, self.effects, free=state.free, values=values)
        moved = {}
        for effect in self.effects:
            change = step[effect.name]
            if effect.shared and effect.field_of is None and change.any():  # to the null's step
                change = change - self.scores.bias.get(effect.name, 0.0)
            most = PLAUSIBLE * self.deviation[effect.name] if effect.shared else np.inf
            moved[effect.name] = np.minimum(values[effect.name] + change, most)
        volume = mean_volume(fits)
        moved = without_gauge(moved, self.observations[0], volume, state.free, self.held)
        for effect in self.effects:
            if effect.positive:
                moved[effect.name] = np.maximum(moved[effect.name], 0)
        sizes = [np.abs((moved[n] - values[n]) / self.deviation[n]).max() for n in moved]
        fits = self._seen_again(fits, moved)
        return replace(state, fits=fits, values=moved), float(max(sizes))

    def _seen_again(self, fits: Sequence[Fit], values: Values) -> tuple[Fit, ...]:
        """Return the fits of the images without effects of these values."""
        seen = corrected(self.observations, self.effects, values)
        found = continued(fits, seen, self.active)
        return tuple(next_fit(fit).with_trust() for fit in found)


def _without_hidden(state: State, views: NDArray[np.bool_]) -> State:
    """Return the state without the pixels of some views that lost their weight in most frames."""
    system = state.fits[0].system
    often = np.mean([fit.trust < 0.5 for fit in state.fits], axis=0)
    wide = [
        binary_dilation(image > 0, iterations=WIDER).astype(np.float32) * view
        for image, view in zip(system.images((often > 0.5).astype(np.float32)), views, strict=True)
    ]
    kept = ~(system.flatten(wide) > 0)
    fits = [replace(fit, usable=fit.usable & kept) for fit in state.fits]
    for _ in range(2):
        fits = [next_fit(fit).with_trust() for fit in fits]
    return replace(state, fits=tuple(fits), hidden=state.hidden | views)
