"""How well the sightings determine the cameras."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.bundle import information
from rigs.calibrate.adjust.joint_terms import fall_of_squares
from rigs.calibrate.adjust.observation_arrays import Freedom, Scene, Sightings, predicted
from rigs.rig import Rig

_UNKNOWN_FOCAL_LENGTH = 0.2  # standard deviation relative to it
_SINGULAR = 1e-13  # least eigenvalue of the normal equations, scaled to a unit diagonal


def covariance_of(
    rig: Rig, scene: Scene, sightings: Sightings, freedom: Freedom
) -> tuple[float, NDArray[np.float64]]:
    """Return the pixel noise and the covariance of the cameras' free parameters ``(P, P)``.

    Raises
    ------
    ValueError
        Naming the camera and the parameter least known, if they are not determined.
    """
    matrix, _ = information(scene, sightings, freedom)
    residuals = sightings.uv - predicted(scene, sightings)
    unknowns = len(matrix) + 6 * len(np.unique(sightings.frame))
    if residuals.size <= unknowns:
        raise ValueError(
            f"observations: found {residuals.size} coordinates, expected more than the "
            f"{unknowns} unknowns of cameras and target poses"
        )
    variance = float((residuals**2).sum()) / (residuals.size - unknowns)
    if not len(matrix):
        return float(np.sqrt(variance)), matrix
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix * np.outer(scale, scale))
    if values[0] < _SINGULAR * values[-1]:
        weakest = int(np.argmax(np.abs(vectors[:, 0])))
        camera, name = labels(rig.names, freedom)[weakest]
        raise ValueError(
            f"camera {camera}: {name} is not determined by the sightings, expected the target "
            "tilted in different directions, all over the image, and shared by cameras"
        )
    inverse = (vectors / values) @ vectors.T
    return float(np.sqrt(variance)), variance * inverse * np.outer(scale, scale)


def labels(names: tuple[str, ...], freedom: Freedom) -> tuple[tuple[str, str], ...]:
    """Return camera and name of each free parameter."""
    found = []
    for camera, name in enumerate(names):
        own = ["wx", "wy", "wz", "tx", "ty", "tz", "fx", "fy", "cx", "cy"]
        own += [f"c{i}" for i in range(len(freedom.lens[camera]) - 4)]
        free = freedom.columns(camera)
        found += [(name, label) for label, is_free in zip(own, free, strict=True) if is_free]
    return tuple(found)


def focal_errors(scene: Scene, freedom: Freedom, covariance: NDArray) -> NDArray[np.float64]:
    """Return the larger relative standard deviation of each camera's two focal lengths."""
    errors = np.zeros(len(scene.lenses))
    for camera, own in enumerate(freedom.slices):
        free = freedom.columns(camera)
        for place in (6, 7):
            if free[place]:
                at = own.start + int(free[:place].sum())
                focal = scene.lenses[camera].matrix[place - 6, place - 6]
                errors[camera] = max(errors[camera], np.sqrt(covariance[at, at]) / focal)
    return errors


def refuse_unknown_lenses(focal_error: NDArray[np.float64], names: tuple[str, ...]) -> None:
    """Raise if a focal length is not known: the rig would look fine and not be."""
    worst = int(np.argmax(focal_error))
    if focal_error[worst] > _UNKNOWN_FOCAL_LENGTH:
        raise ValueError(
            f"camera {names[worst]}: its focal length is uncertain by "
            f"{100 * focal_error[worst]:.0f} %, expected views of the target tilted in different "
            "directions, not all parallel, or given intrinsics"
        )


def lens_misfit(
    scene: Scene, sightings: Sightings, freedom: Freedom, noise: float
) -> NDArray[np.float64]:
    """Return by how many standard deviations the lenses held fixed do not fit, ``(cameras,)``.

    The root of what the sum of squares would fall by, were all of one camera's lens free too,
    for each number freed; about 1 when the lens is right, 0 where it is free already. To first
    order (Rao's score test).
    """
    misfit = np.zeros(len(scene.lenses))
    every = Freedom(tuple(np.ones(lens.size, bool) for lens in scene.lenses), freedom.pose)
    matrix, gradient = information(scene, sightings, every)
    free = np.concatenate(
        [freedom.columns(camera)[every.columns(camera)] for camera in range(len(misfit))]
    )
    for camera, own in enumerate(every.slices):
        freed = np.zeros(len(free), bool)
        freed[own] = ~free[own]
        if freed.any():
            gain = fall_of_squares(matrix, gradient, free | freed)
            misfit[camera] = np.sqrt(gain / int(freed.sum())) / max(noise, 1e-9)
    return misfit
