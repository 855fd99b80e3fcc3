"""What images say is wrong, as findings: effects that were found beside the voxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from tomo.inference.finding import Finding
from tomo.inference.infer import Inference
from tomo.inference.state import State
from tomo.inference.steps import fraction_outside
from tomo.model import Background, Corrections, Observation


def findings_of(
    found: Inference, corrections: Corrections, observation: Observation
) -> list[Finding]:
    """Return what is said of each effect that was let loose unasked, the gravest first."""
    said, names, state = [], corrections.names, found.state
    for effect in found.effects:
        values = corrections.values[effect.name]
        score = found.scores.get(effect.name, np.zeros(len(names)))
        if effect.shared and values.any():
            size, most = float(values[0, 0]), float(score.max())
            if effect.of_gas:
                said.append(Finding("absorption", size=size, score=most))
            else:
                said.append(Finding(effect.name, size=size, unit="%", score=most))
        elif not effect.shared:
            free = state.free[effect.name].any(axis=1) | (effect.name == Background.name)
            free &= ~found.refined.get(effect.name, np.zeros(len(names), bool))
            for view in np.flatnonzero(free & values.any(axis=1)):
                camera = observation.rig[names[view]]
                what, size, unit = _size(effect.name, values[view], camera, observation)
                said.append(Finding(what, camera.name, size, unit=unit, score=float(score[view])))
    for view in np.flatnonzero(state.hidden):
        fraction = float(corrections.untrusted[names[view]].mean())
        if fraction > 0:
            what = "scatter" if _is_brighter(state, int(view)) else "hidden"
            most = float(found.scores["hidden"][view])
            said.append(Finding(what, names[view], fraction, unit="%", score=most))
    if found.state.has_outside:
        most = float(found.scores["outside"].max())
        size = fraction_outside(state.fits)
        said.append(Finding("outside", size=size, unit="%", score=most, corrected=False))
    return sorted(said, key=lambda one: -one.score)


def _is_brighter(state: State, view: int) -> bool:
    """Return whether the pixels left out of a view are brighter than the volumes say."""
    light = 0.0
    for fit in state.fits:
        own = slice(*fit.system.projector.view_ptr[view : view + 2])
        light += float(np.sum(fit.residual[own], where=~fit.usable[own]))
    return light > 0


def _size(
    effect: str, values: NDArray[np.float64], camera: CameraLike, observation: Observation
) -> tuple[str, float, str]:
    """Return what an effect of one camera is called, its size and unit."""
    if effect == "gain":
        return effect, float(np.expm1(values[0])), "%"
    if effect == "background":
        return effect, float(values[0]) / observation.brightest, "%"
    if effect == "blur":
        return effect, float(np.sqrt(values[0])), "px"
    zoom = abs(values[3])
    if zoom > np.abs(np.delete(values, 3)).max():
        radius = min(camera.image_size) / 2
        return "magnification", float(np.expm1(values[3] / radius)), "%"
    return effect, float(np.linalg.norm(values)), "px"
