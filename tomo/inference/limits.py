"""Detection limits: the smallest effects of cameras and gas that images would tell from chance.

An effect is noticed when its step exceeds what exact cameras make of it, see
`tomo.inference.scores`. Voxels explain a part of an effect, and so do other effects and the gauge.
What is left is measured: each effect is added to the images of a view, by the columns that the
joint solve has, and the voxels and the steps are found again.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.inference.fit import Fit
from tomo.inference.infer import Inference
from tomo.inference.scores import NEGLIGIBLE
from tomo.inference.solve import Values, next_fit
from tomo.inference.steps import Steps
from tomo.model.effect import Effect

CONFUSED = 0.8
"""Score of another effect over that of the one that is there, from which the two look alike."""


@dataclass(frozen=True, eq=False)
class DetectionLimits:
    """The smallest effects that would be noticed.

    ``sizes`` (views,) are by effect and parameter, in the parameter's own unit; infinite where
    images never tell. Effects that are ``alike`` images do not tell apart: the first may be
    taken for the second.
    """

    cameras: tuple[str, ...]
    sizes: Mapping[tuple[str, str], NDArray[np.float64]]
    alike: tuple[tuple[str, str], ...] = ()


def detection_limits(found: Inference, draw_null: bool = False) -> DetectionLimits:
    """Return the smallest effects that would have been noticed in a scene.

    A unit of an effect raises its score by ``response / hypot(spread, least)``, and the size that
    raises it to the limit of `tomo.inference.scores.Scores` is returned.

    With ``draw_null`` scenes of exact cameras are drawn where no effect was large enough to
    ask for them. Otherwise the steps of the scene itself stand for theirs, and effects that
    all views share have no limit.
    """
    steps = Steps(found.state.fits, found.effects, found.state.values)
    sizes, alike = _of_cameras(found, steps, draw_null)
    if draw_null:
        for effect in found.effects:
            if effect.shared and effect.field_of is None:
                size = _of_all(found, steps, effect)
                sizes[effect.name, effect.parameters[0]] = np.full(len(found.state.hidden), size)
    names = tuple(found.state.fits[0].observation.rig.names)
    return DetectionLimits(names, sizes, tuple(alike))


def _of_cameras(
    found: Inference, steps: Steps, draw_null: bool
) -> tuple[dict[tuple[str, str], NDArray[np.float64]], list[tuple[str, str]]]:
    """Return the limits of effects of single views, and which look alike."""
    scores, views = found.tested, len(found.state.hidden)
    own = {effect.name: effect for effect in found.effects if not effect.shared}
    deviation = {name: scores.deviation[name] for name in own}
    unit = {
        name: np.hypot(scores.spread_of(name, steps, draw_null), NEGLIGIBLE * deviation[name])
        for name in own
    }
    keys = [(name, k) for name, effect in own.items() for k in range(len(effect.parameters))]
    raised = {}  # scores of all effects by a deviation of each
    for start in range(0, len(keys), views):
        added = {name: np.zeros_like(one) for name, one in deviation.items()}
        for view, (name, k) in enumerate(keys[start : start + views]):
            added[name][view, k] = deviation[name][view, k]
        after = Steps(_fits_with(steps.fits, own.values(), added), found.effects, steps.values)
        for view, key in enumerate(keys[start : start + views]):
            change = {name: np.abs(after.own[name][view] - steps.own[name][view]) for name in own}
            raised[key] = np.array([(change[name] / unit[name][view]).max() for name in own])
    sizes, alike = {}, []
    for (name, k), score in raised.items():
        mine = score[list(own).index(name)]
        with np.errstate(divide="ignore"):
            sizes[name, own[name].parameters[k]] = scores.own_limit * deviation[name][:, k] / mine
        alike += [
            (own[name].parameters[k], other)
            for other, value in zip(own, score, strict=True)
            if other != name and value >= CONFUSED * mine
        ]
    return sizes, alike


def _of_all(found: Inference, steps: Steps, effect: Effect) -> float:
    """Return the smallest size of an effect that all views share that would be noticed."""
    deviation = found.tested.deviation[effect.name]
    fits = _fits_with(steps.fits, [effect], {effect.name: deviation})
    after = Steps(fits, found.effects, steps.values)
    change = (after.shared(effect) - steps.shared(effect)) / deviation[0, 0]
    _, spread = found.tested.shared_null(effect, steps)
    least = float(np.hypot(spread, NEGLIGIBLE * deviation[0, 0]))
    return found.tested.shared_limit * least / change if change > 0 else np.inf


def _fits_with(
    fits: tuple[Fit, ...], effects: Iterable[Effect], values: Values
) -> tuple[Fit, ...]:
    """Return the fits of voxels alone to the images with small effects added."""
    made = []
    for fit in fits:
        prediction, added = fit.prediction, np.zeros_like(fit.measured)
        for effect in effects:
            added += prediction.changed_by(effect, values[effect.name])
        made.append(next_fit(replace(fit, measured=fit.measured + added)).with_trust())
    return tuple(made)
