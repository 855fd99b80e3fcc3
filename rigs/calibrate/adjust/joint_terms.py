"""Lens terms that pay only where cameras see together: freed after the joint adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import information
from rigs.calibrate.adjust.lens_choice import TERMS, Terms
from rigs.calibrate.adjust.observation_arrays import Freedom, Scene, Sightings, predicted

_LADDER = ("none", "radial", "brown4", "brown5")


def fall_of_squares(
    matrix: NDArray[np.float64], gradient: NDArray[np.float64], free: NDArray[np.bool_]
) -> float:
    """Return what the sum of squares would fall by, were all of ``free`` adjusted, to first order.

    Parameters
    ----------
    matrix, gradient : (P, P), (P,) float64
        Of `information`.
    free : (P,) bool
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix)[free], 1e-300))
    values, vectors = np.linalg.eigh(matrix[np.ix_(free, free)] * np.outer(scale, scale))
    along = vectors.T @ (gradient[free] * scale)
    known = values > 1e-10 * values[-1]
    return float((along[known] ** 2 / values[known]).sum())


def richer_terms(
    scene: Scene,
    sightings: Sightings,
    freedom: Freedom,
    terms: list[Terms],
) -> tuple[Scene, Freedom, list[Terms]] | None:
    """Return the scene with more terms free where they pay in the joint adjustment, else None.

    A camera by itself cannot always tell its lens from where the target stands. Of the terms up
    to brown5 those are taken whose fall of the sum of squares exceeds twice the noise's variance
    a term by most (Akaike's criterion); the fall is that of the joint normal equations (Rao's
    score test).

    Parameters
    ----------
    scene : Scene
        Adjusted with ``freedom``.
    sightings : Sightings
        Those used.
    freedom : Freedom
    terms : list of Terms
        Each camera's.
    """
    can = [one.name in _LADDER[:-1] for one in terms]
    if not any(can):
        return None
    wide = replace(
        scene,
        lenses=tuple(
            lens.with_model("brown", 5) if grows else lens
            for lens, grows in zip(scene.lenses, can, strict=True)
        ),
    )
    every = Freedom(
        tuple(np.ones(lens.size, bool) for lens in wide.lenses),
        freedom.pose,
    )
    matrix, gradient = information(wide, sightings, every)
    now = [
        np.r_[own, np.zeros(9 - len(own), bool)] if grows else own
        for own, grows in zip(freedom.lens, can, strict=True)
    ]
    place = every.slices
    columns = Freedom(tuple(now), freedom.pose)
    free = np.concatenate(
        [columns.columns(camera)[every.columns(camera)] for camera in range(len(terms))]
    )
    residuals = sightings.uv - predicted(scene, sightings)
    unknowns = int(free.sum()) + 6 * len(np.unique(sightings.frame))
    variance = float((residuals**2).sum()) / max(residuals.size - unknowns, 1)
    base = fall_of_squares(matrix, gradient, free)
    chosen = list(terms)
    for camera in np.flatnonzero(can):
        best = 0.0
        for name in _LADDER[_LADDER.index(terms[camera].name) + 1 :]:
            freed = np.zeros(len(free), bool)
            lens = np.zeros(9, bool)
            lens[: 4 + len(TERMS[name].free)] = TERMS[name].freedom()
            freed[place[camera]][-9:] = lens
            count = int((freed & ~free).sum())
            gain = fall_of_squares(matrix, gradient, free | freed) - base - 2 * count * variance
            if gain > best:
                best, chosen[camera] = gain, TERMS[name]
    if chosen == terms:
        return None
    lenses, lens_freedom = list(scene.lenses), list(freedom.lens)
    for camera, (one, before) in enumerate(zip(chosen, terms, strict=True)):
        if one != before:
            lenses[camera] = lenses[camera].with_model(one.model, len(one.free))
            lens_freedom[camera] = one.freedom()
    return (
        replace(scene, lenses=tuple(lenses)),
        Freedom(tuple(lens_freedom), freedom.pose),
        chosen,
    )
