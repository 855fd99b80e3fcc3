"""Lens terms that only the joint adjustment determines: freed after it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import information
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.lens_choice import TERMS, LensRules, Terms
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted

_LADDER = ("none", "radial", "brown4", "brown5")


def fall_of_squares(
    matrix: NDArray[np.float64], gradient: NDArray[np.float64], free: NDArray[np.bool_]
) -> float:
    """Return the fall of the sum of squares if all of ``free`` were adjusted, to first order.

    Parameters
    ----------
    matrix, gradient : (P, P), (P,) float64
        From `information`.
    free : (P,) bool
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix)[free], 1e-300))
    values, vectors = np.linalg.eigh(matrix[np.ix_(free, free)] * np.outer(scale, scale))
    along = vectors.T @ (gradient[free] * scale)
    known = values > 1e-10 * values[-1]
    return float((along[known] ** 2 / values[known]).sum())


def richer_terms(
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    terms: list[Terms],
    rules: LensRules,
) -> tuple[Scene, Freedom, list[Terms]] | None:
    """Return the scene with more terms free where the joint adjustment supports them, else None.

    One camera's images cannot always separate its lens from the target's pose. Candidates are the
    terms up to brown5. The one is taken whose fall of the sum of squares exceeds twice the noise's
    variance a term by most (Akaike's criterion); the fall is predicted from the joint normal
    equations (Rao's score test).

    Parameters
    ----------
    scene : Scene
        Adjusted with ``freedom``.
    observations : ObservationArrays
        Without outliers.
    freedom : Freedom
    terms : list of Terms
        Each camera's.
    rules : LensRules
    """
    may_grow = [one.name in _LADDER[:-1] for one in terms]
    if not any(may_grow):
        return None
    wide = replace(
        scene,
        lenses=tuple(
            lens.with_model("brown", 5) if grows else lens
            for lens, grows in zip(scene.lenses, may_grow, strict=True)
        ),
    )
    full = [
        TERMS["brown5"].freedom(rules) if grows else np.ones(lens.size, bool)
        for lens, grows in zip(wide.lenses, may_grow, strict=True)
    ]
    every = replace(freedom, lens=tuple(full))
    matrix, gradient = information(wide, observations, every)
    free = every.freed_in(freedom)
    residuals = observations.uv - predicted(scene, observations)
    unknowns = int(free.sum()) + 6 * len(np.unique(observations.frame))
    variance = float((residuals**2).sum()) / max(residuals.size - unknowns, 1)
    base = fall_of_squares(matrix, gradient, free)
    chosen = list(terms)
    first = range(len(terms)) if rules.common is None else rules.common
    for camera in (camera for camera in np.flatnonzero(may_grow) if first[camera] == camera):
        best = 0.0
        for name in _LADDER[_LADDER.index(terms[camera].name) + 1 :]:
            lens = TERMS[name].freedom(rules)
            tried = (lens if first[k] == camera else own for k, own in enumerate(freedom.lens))
            freed = free | every.freed_in(replace(freedom, lens=tuple(tried)))
            count = int((freed & ~free).sum())
            gain = fall_of_squares(matrix, gradient, freed) - base - 2 * count * variance
            if gain > best:
                best, chosen[camera] = gain, TERMS[name]
    chosen = [chosen[camera] for camera in first]
    if chosen == terms:
        return None
    lenses, lens_freedom = list(scene.lenses), list(freedom.lens)
    for place, (one, before) in enumerate(zip(chosen, terms, strict=True)):
        if one != before:
            lenses[place] = lenses[place].with_model(one.model, len(one.free))
            lens_freedom[place] = one.freedom(rules)
    return (
        replace(scene, lenses=tuple(lenses)),
        replace(freedom, lens=tuple(lens_freedom)),
        chosen,
    )
