"""Effects found beside the voxels, one at a time, as far as they exceed what exact cameras make.

All effects are scored from one fit, the largest is let loose and found together with the voxels,
and all are scored again, until none exceeds its null.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rigs.progress import Progress
from tomo.grid import ActiveVoxels
from tomo.inference.adaptation import Adaptation
from tomo.inference.fit import Fit
from tomo.inference.left_out import LeftOut, contradicts, predict_left_out, without_left_out
from tomo.inference.scores import Scores
from tomo.inference.solve import first_fits
from tomo.inference.state import HIDDEN, State, corrected
from tomo.model import Gain
from tomo.model.effect import Effect
from tomo.model.observation import Observation
from tomo.model.pose import stated_errors

FEWEST_VIEWS = 3
"""Views that effects need at least: whatever is wrong, some volume reproduces two."""

ROUNDS = 8
"""Effects that are let loose, one after the other. More take longer where cameras all err."""

PATIENCE = 3
"""Effects in a row that predict left-out pixels not clearly better, after which none is looked
for. Fewer, what hides another is lost; more take longer where voxels do not resolve a flame."""


@dataclass(frozen=True, eq=False)
class Inference:
    """What was found beside the voxels.

    ``tested`` is what the effects were compared with, ``refined`` (views,) what was let loose
    of some views for the asking, and kept; ``left_out`` says how left-out pixels judge that.
    """

    effects: tuple[Effect, ...]
    state: State
    tested: Scores
    refined: Mapping[str, NDArray[np.bool_]] = field(default_factory=dict)
    left_out: LeftOut | None = None

    @property
    def scores(self) -> dict[str, NDArray[np.float64]]:
        """How far effects exceeded their null when they were let loose, or at the end.

        By effect, ``(views,)``; 1 is the limit.
        """
        return self.tested.highest

    @property
    def spread(self) -> dict[str, NDArray[np.float64]]:
        """What exact cameras make of each effect that was tested, ``(parameters,)``."""
        return self.tested.spread

    def with_wrong_view(self, view: int, score: float) -> Inference:
        """Return this inference, made without a view that contradicts the others by a score."""
        hidden = self.state.hidden.copy()
        hidden[view] = True
        self.tested.highest[HIDDEN][view] = score
        return replace(self, state=replace(self.state, hidden=hidden))


def infer(
    frames: Sequence[Observation],
    effects: Sequence[Effect],
    active: ActiveVoxels | None = None,
    asked: Sequence[str] = (),
    look_outside: bool = True,
    first: Sequence[Fit] | None = None,
    refine: Mapping[str, NDArray[np.bool_]] | None = None,
    progress: Progress | None = None,
) -> Inference:
    """Return the effects that exceed their null, found together with the voxels.

    Parameters
    ----------
    frames : sequence of Observation
        One of a still, several of a film: the same cameras, usable pixels, voxels and gas at
        several moments. Each has voxels of its own, and effects are common to all. Coarse copies
        will do.
    active : ActiveVoxels, optional
        The voxels that dark pixels do not prove empty.
    asked : sequence of str
        Effects that are let loose whatever their score.
    look_outside : bool
        Whether light may come from around the grid.
    first : sequence of Fit, optional
        See `tomo.inference.solve.first_fits`, where they are known.
    refine : mapping of str to (views,) bool, optional
        Effects that are let loose in some views whatever their score, and kept where left-out
        pixels are then predicted better. The other views hold the scene.
    progress : callable, optional
        Told each effect that is compared with its null, and each round.
    """
    views = len(frames[0].rig)
    none = {e.name: np.zeros((views, len(e.parameters))) for e in effects}
    kept = {n: np.full(views, n in asked) for n in none}
    free = {n: np.full(v.shape, n in asked) for n, v in none.items()}
    state = State(tuple(first or first_fits(frames, active)), none, free, np.zeros(views, bool))
    scores = Scores(frames[0], effects, active, look_outside)
    adaptation = Adaptation(frames, effects, active, scores, refine or ())
    if asked:
        state = adaptation.relaxed(state)
    refined: Mapping[str, NDArray[np.bool_]] = {}
    left_out = None
    if refine:
        loose = replace(state, fits=without_left_out(state.fits))
        for name, some in refine.items():
            loose = loose.loosened(name, some)
        loose = adaptation.relaxed(loose)
        loose = replace(loose, fits=first_fits(corrected(frames, effects, loose.values), active))
        left_out = predict_left_out(state, loose)
        if left_out.is_better:
            state, refined = adaptation.relaxed(loose), refine
            kept = {name: one | refine.get(name, False) for name, one in kept.items()}
    given = state
    state, doubt = _searched(given, scores, adaptation, progress)
    if state is not given:
        state = adaptation.pruned(state, kept)
    wrong = _wrong_view(state, doubt, scores)
    if wrong is not None:
        rest = [one.without(wrong) for one in frames]
        found = infer(rest, effects, active, asked, look_outside, None, refine, progress)
        return found.with_wrong_view(wrong, scores.highest[HIDDEN][wrong])
    if state is not given and not predict_left_out(given, state).is_clearly_better:
        state = given
    for effect in effects:
        if effect.shared and (state.free[effect.name] & ~given.free[effect.name]).any():
            less = adaptation.without_effect(state, effect.name)
            if not predict_left_out(less, state).is_clearly_better:
                state = less
    return Inference(tuple(effects), state, scores, refined, left_out)


def _searched(
    given: State, scores: Scores, adaptation: Adaptation, progress: Progress | None
) -> tuple[State, NDArray[np.intp]]:
    """Return the state with all effects that exceed their null, but for those that mislead.

    And how many effects of single views were tried in each view, ``(views,)``.
    """
    tested = len(scores.effects)

    def tell(done: int, where: str) -> None:
        if progress:
            progress(done, tested + ROUNDS, where)

    state, ratio = given, scores.ratios(given, tell)
    barred: set[str] = set()
    doubt, in_vain = np.zeros(len(given.hidden), int), 0
    for number in range(ROUNDS):
        tell(tested + number, "what is found")
        if max(float(one.max()) for one in ratio.values()) < 1:
            break
        found = adaptation.adapted(state, ratio)
        doubt += found.views_looser_than(state)
        judged = predict_left_out(state, found)
        in_vain = 0 if judged.is_clearly_better else in_vain + 1
        if in_vain == PATIENCE:
            break
        if not judged.is_better:
            barred |= found.looser_than(state)
        else:
            state, ratio = found, scores.ratios(found)
        ratio |= {name: np.zeros_like(ratio[name]) for name in barred}
    return state, doubt


def _wrong_view(state: State, doubt: NDArray[np.intp], scores: Scores) -> int | None:
    """Return a view that contradicts the others even where it hides nothing, the worst, if any."""
    taking_part = np.array([state.takes_part(view) for view in range(len(doubt))])
    others, doubt = taking_part & (doubt == 0), doubt * taking_part
    if taking_part.sum() > FEWEST_VIEWS:
        for view in np.argsort(-doubt, kind="stable")[: np.count_nonzero(doubt)]:
            if contradicts(state.fits, scores.null, int(view), others):
                return int(view)
    return None


def light_error(found: Inference) -> float:
    """Return the standard deviation of the total light by the effects, relative to it.

    Notes
    -----
    A parameter ``t`` of a view changes that view's light by the fraction ``c t``, the sum of its
    column over that of its prediction, and the total by a view's share of it. Parameters that were
    let loose err by what exact cameras make of them. Gains are relative to the mean of those that
    set the scale, whose spread leaves a scale of its standard error. Lenses that err in
    magnification by a fraction err in areas, and so in light, by twice that.
    """
    state, spread = found.state, found.spread
    fit = state.fits[0]
    views = len(state.hidden)
    at = fit.prediction
    light = np.maximum(fit.view_sums(at.pixels), np.finfo(np.float64).tiny)  # (views,)
    squares = 0.0
    for effect in found.effects:
        free = state.free[effect.name]
        if not free.any() or effect.name not in spread or effect.field_of is not None:
            continue
        change = (fit.view_sums(effect.columns(at)) / light).T  # (views, parameters)
        error = change * np.where(free, spread[effect.name], 0.0) / views
        squares += float(error.sum() if effect.shared else np.linalg.norm(error)) ** 2
        if effect.name == Gain.name:
            sure = np.array(fit.observation.sets_scale or (True,) * views)
            logarithms = state.values[effect.name][sure, 0]
            if len(logarithms) > 1:
                squares += float(logarithms.var(ddof=1)) / len(logarithms)
    return float(np.sqrt(squares + _of_lenses(found) ** 2))


def _of_lenses(found: Inference) -> float:
    """Return the relative error of light by lenses whose magnification the rig does not know."""
    seen = found.state.fits[0].observation
    across = np.array([min(camera.image_size) / 2 for camera in seen.rig])
    zoom = stated_errors(seen.rig, seen.grid, seen.pixel)[:, 3] / across
    return float(2 * np.linalg.norm(zoom) / len(zoom))
