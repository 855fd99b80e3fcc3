"""The gauge: what no image can tell, taken out of the effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from rigs.scene.scene_camera import own_camera
from tomo.model.observation import Observation
from tomo.model.pose import Pose, image_motions, stated_errors

FLOOR = 0.03
"""Length in pixels below which motions count by their squares: smaller, iterations jump."""

POINTS = 500
"""Voxels, the brightest, that stand for the scene."""

REWEIGHTINGS = 30
"""Of the least sum of lengths; it has settled by then."""


def without_gauge(
    values: Mapping[str, NDArray[np.float64]],
    observation: Observation,
    volume: NDArray,
    free: Mapping[str, NDArray[np.bool_]] | None = None,
    held: Collection[str] = (),
) -> dict[str, NDArray[np.float64]]:
    """Return effects without a common gain or blur, and without a motion or growth of the scene.

    Where single views may be wrong, the sum of the views' lengths is made least, so that one may
    be far off and the others right; the median of the gains is one. Where ``free`` says that most
    views may be wrong, least squares are, and what is bright stays where most saw it: a scene that
    is moved as a whole would be paid for by cameras that are held out. Either way a camera holds
    the scene the less, the farther off it may be by what the rig states of it and by what mounts
    do. Effects that are ``held`` keep their values as long as one view is not free: it holds them.
    """
    found, views = dict(values), len(observation.rig)
    loose = {name: views if free is None else free[name].any(axis=1).sum() for name in found}
    most = {name: bool(loose[name] > (views - 1 if name in held else views / 2)) for name in found}
    sure = list(observation.sets_scale or (True,) * len(observation.rig))
    for name in {"gain", "blur"} & set(found):
        if most[name]:
            found[name] = found[name] - np.median(found[name][sure])
    if "pose" in found and most["pose"] and found["pose"].any():
        motions, images = scene_motions(observation, volume)
        trust = 1 / _doubt(observation)[:, None, None]
        if free is None:
            found["pose"] = _shortest(found["pose"], motions, trust)
        else:
            left = _less(found["pose"], motions, trust * np.eye(6))
            found["pose"] = _less(left, motions[:, :, :6], trust * images)  # zooms keep its size
    return found


def _doubt(observation: Observation) -> NDArray[np.float64]:
    """Return how far off each camera may be, in units of the best known one, ``(views,)``."""
    stated = stated_errors(observation.rig, observation.grid, observation.pixel)
    mounts = Pose.sigma / observation.pixel
    found = np.sqrt(np.square(stated).mean(axis=1) + mounts**2)
    return found / found.min()


def scene_motions(
    observation: Observation, volume: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what motions and a growth of the scene make of each view, ``(views, 6, 7)``.

    By the parameters of `tomo.model.Pose`; the modes are three shifts, three turns and a growth
    about the middle of the light, fitted to the images of the brightest voxels. Also ``R``,
    ``(views, 6, 6)``: ``|R t|`` is the root mean square, over the light, of what the motion ``t``
    moves images by.
    """
    points, weight = _brightest(observation, volume)
    grid, rig = observation.grid, observation.rig
    step, span = 0.01 * min(grid.extent), max(grid.extent)
    middle, axes = np.asarray(grid.center), np.eye(3)[:, None]
    about = (points - middle) / span
    shifts = np.broadcast_to(axes, (3, *points.shape))
    modes = step * np.concatenate([shifts, np.cross(axes, about), about[None]])  # (7, N, 3)
    found, images = np.zeros((len(rig), 6, len(modes))), np.zeros((len(rig), 6, 6))
    for view, camera in enumerate(rig):
        by_pose, by_point = image_motions(camera, points, middle)
        if not own_camera(camera).has_pose:
            by_pose[2:4] = 0
        both = np.concatenate([by_pose, np.einsum("nij,knj->kni", by_point, modes)])
        seen = np.isfinite(both).all(axis=(0, 2))[:, None]
        both = np.where(seen, both * weight[:, None], 0).reshape(len(both), -1).T  # (2 N, 13)
        found[view] = np.linalg.lstsq(both[:, :6], both[:, 6:], rcond=1e-9)[0]
        images[view] = np.linalg.qr(both[:, :6])[1]
    return found, images


def _brightest(observation: Observation, volume: NDArray) -> tuple[NDArray, NDArray]:
    """Return the centres of the brightest voxels and the roots of their light."""
    grid = observation.grid
    axes = [
        low + step * (np.arange(n) + 0.5)
        for low, step, n in zip(grid.lower, grid.spacing, grid.shape, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    light = np.maximum(volume, 0).ravel().astype(np.float64)
    order = np.argsort(-light, kind="stable")[: max(len(light) // 20, 200)]
    order = order[:: len(order) // POINTS + 1]
    light = light[order] + np.finfo(np.float32).tiny
    return points[order], np.sqrt(light / light.sum())


def _shortest(
    motion: NDArray[np.float64], modes: NDArray[np.float64], trust: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motions less the scene's, of the least sum of lengths by the views' trust."""
    trust = trust.ravel()
    weight, left = trust**2, motion
    for _ in range(REWEIGHTINGS):
        left = _less(motion, modes, np.sqrt(weight)[:, None, None] * np.eye(motion.shape[1]))
        weight = trust**2 / np.hypot(trust * np.linalg.norm(left, axis=1), FLOOR)
    return left


def _less(
    motion: NDArray[np.float64], modes: NDArray[np.float64], roots: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motions less the scene's, of the least sum of ``|R t|²`` over the views."""
    flat = (roots @ modes).reshape(-1, modes.shape[2])
    whole = np.einsum("vij,vj->vi", roots, motion).ravel()
    return motion - modes @ np.linalg.lstsq(flat, whole, rcond=1e-9)[0]
