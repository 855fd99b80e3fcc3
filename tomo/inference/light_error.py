"""How far the total light may be off because of what was found of cameras and gas."""

from __future__ import annotations

import numpy as np

from tomo.inference.infer import Inference
from tomo.model import Gain
from tomo.model.stated import stated_errors


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
