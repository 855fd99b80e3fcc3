"""Covariance of the cameras' parameters, and how well lenses are determined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import fall_of_squares, information, scaled_eigen
from rigs.calibrate.adjust.freedom import FX, NUMBERS, Freedom
from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.rig import Rig
from rigs.scene.sight_lines import WINDOW_NUMBERS

_UNKNOWN_FOCAL_LENGTH = 0.2  # relative standard deviation; above it the focal length is a guess
SINGULAR = 1e-13  # relative least eigenvalue of the normal equations; below it is rounding


def covariance_of(
    rig: Rig, scene: Scene, observations: ObservationArrays, freedom: Freedom
) -> tuple[float, NDArray[np.float64]]:
    """Return the pixel noise and the covariance of the cameras' free parameters ``(P, P)``.

    A ValueError names the camera and the least determined parameter where the matrix is singular.
    """
    matrix, _ = information(scene, observations, freedom)
    residuals = observations.uv - predicted(scene, observations)
    unknowns = len(matrix) + 6 * len(np.unique(observations.frame))
    if residuals.size <= unknowns:
        raise ValueError(
            f"observations: found {residuals.size} coordinates, expected more than the "
            f"{unknowns} unknowns of cameras and target poses"
        )
    variance = float((residuals**2).sum()) / (residuals.size - unknowns)
    if not len(matrix):
        return float(np.sqrt(variance)), matrix
    scale, values, vectors = scaled_eigen(matrix)
    if values[0] < SINGULAR * values[-1]:
        weakest = int(np.argmax(np.abs(vectors[:, 0])))
        camera, name = labels(rig.names, freedom, scene.windows)[weakest]
        raise ValueError(
            f"camera {camera}: {name} is not determined by the observations, expected the target "
            "tilted in different directions, all over the image, and shared by cameras"
        )
    inverse = (vectors / values) @ vectors.T
    return float(np.sqrt(variance)), variance * inverse * np.outer(scale, scale)


def root_of(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a matrix whose product with its transpose is a covariance, ``(P, P)``."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(deviation, deviation))
    return deviation[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def labels(
    names: tuple[str, ...], freedom: Freedom, windows: tuple[str, ...] = ()
) -> tuple[tuple[str, str], ...]:
    """Return camera and name of each free parameter; a shared one has those that come first.

    Those of adjusted windows have the window's name for the camera's.
    """
    found: list[tuple[str, str]] = [("", "")] * freedom.size
    for camera, name in enumerate(names):
        coefficients = [f"c{i}" for i in range(len(freedom.lens[camera]) - 4)]
        own = [*NUMBERS, *coefficients, "time"]
        for place, label in zip(freedom.places[camera], own, strict=False):
            if place >= 0 and not found[place][0]:
                found[place] = name, label
    of_windows = [(window, label) for window in windows for label in WINDOW_NUMBERS]
    for place, of_window in zip(freedom.window_places, of_windows, strict=True):
        if place >= 0:
            found[place] = of_window
    return tuple(found)


def focal_errors(scene: Scene, freedom: Freedom, covariance: NDArray) -> NDArray[np.float64]:
    """Return the larger relative standard deviation of each camera's two focal lengths."""
    errors = np.zeros(len(scene.lenses))
    for camera, places in enumerate(freedom.places):
        for at, focal in zip(places[FX:], np.diag(scene.lenses[camera].matrix)[:2], strict=False):
            if at >= 0:
                errors[camera] = max(errors[camera], np.sqrt(covariance[at, at]) / focal)
    return errors


def refuse_unknown_lenses(focal_error: NDArray[np.float64], names: tuple[str, ...]) -> None:
    """Raise if a focal length is undetermined: residuals would be small and the rig wrong."""
    worst = int(np.argmax(focal_error))
    if focal_error[worst] > _UNKNOWN_FOCAL_LENGTH:
        raise ValueError(
            f"camera {names[worst]}: its focal length is uncertain by "
            f"{100 * focal_error[worst]:.0f} %, expected views of the target tilted in different "
            "directions, not all parallel, or given intrinsics"
        )


def lens_misfit(
    scene: Scene, observations: ObservationArrays, freedom: Freedom, noise: float
) -> NDArray[np.float64]:
    """Return by how many standard deviations what is held of lenses does not fit, ``(cameras,)``.

    ``sqrt(fall / n) / noise``, with the predicted ``fall`` of the sum of squares if n more numbers
    of a camera were free (Rao's score test): a given lens's, a second focal length, the centre, a
    lens of its own. It is about 1 when the lens is right, 0 where nothing is held.
    """
    misfit = np.zeros(len(scene.lenses))
    lenses = tuple(own | (np.arange(len(own)) < 4) if own.any() else ~own for own in freedom.lens)
    every = Freedom(lenses, freedom.pose, freedom.time, windows=freedom.windows)
    shared = list(freedom.common or range(len(misfit)))
    more = []
    for lens, place, own, first in zip(lenses, freedom.places, freedom.lens, shared, strict=True):
        free = len(np.unique(place[6 : 6 + len(own)][own])) if shared.count(first) == 1 else 0
        more.append(int(lens.sum()) - free)
    if not any(more):
        return misfit
    matrix, gradient = information(scene, observations, every)
    held = tuple(np.zeros(len(own), bool) for own in lenses)
    poses = every.freed_in(replace(every, lens=held))
    for camera, (places, count) in enumerate(zip(every.places, more, strict=True)):
        if count:
            freed = poses.copy()
            freed[places[places >= 0]] = True
            gain = fall_of_squares(matrix, gradient, freed)
            misfit[camera] = np.sqrt(gain / count) / max(noise, 1e-9)
    return misfit
