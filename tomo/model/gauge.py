"""The gauge: what no image can tell, taken out of the effects."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tomo.model.effect import image_frame
from tomo.model.observation import Observation

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
) -> dict[str, NDArray[np.float64]]:
    """Return effects without a common gain or blur, and without a motion or growth of the scene.

    Where single views may be wrong, the sum of the views' lengths is made least, so that one may
    be far off and the others right; the median of the gains is one. Where ``free`` says that most
    views may be wrong, least squares are, and what is bright stays where most saw it: a scene that
    is moved as a whole would be paid for by cameras that are held out.
    """
    found = dict(values)
    most = {
        name: free is None or bool(free[name].any(axis=1).sum() > len(observation.rig) / 2)
        for name in found
    }
    sure = list(observation.sets_scale or (True,) * len(observation.rig))
    for name in {"gain", "blur"} & set(found):
        if most[name]:
            found[name] = found[name] - np.median(found[name][sure])
    if "pose" in found and most["pose"] and found["pose"].any():
        motions, images = scene_motions(observation, volume)
        if free is None:
            found["pose"] = _shortest(found["pose"], motions)
        else:
            left = _less(found["pose"], motions, np.broadcast_to(np.eye(6), images.shape))
            found["pose"] = _less(left, motions[:, :, :6], images)  # its size is left to zooms
    return found


def scene_motions(
    observation: Observation, volume: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what motions and a growth of the scene make of each view, ``(views, 6, 7)``.

    The parameters are those of `tomo.model.Pose`; the modes are three shifts, three turns and a
    growth about the middle of the light, fitted to the images of the brightest voxels. Also
    returns ``R``, ``(views, 6, 6)``: ``|R t|`` is the root mean square, over the light, of what
    the motion ``t`` moves images by.
    """
    points, weight = _brightest(observation, volume)
    grid, rig = observation.grid, observation.rig
    step, span = 0.01 * min(grid.extent), max(grid.extent)
    middle, angle = np.asarray(grid.center), step / span
    modes = [points + step * axis for axis in np.eye(3)]
    modes += [points + step * np.cross(axis, points - middle) / span for axis in np.eye(3)]
    modes += [points + step * (points - middle) / span]
    found, images = np.zeros((len(rig), 6, len(modes))), np.zeros((len(rig), 6, 6))
    for view, camera in enumerate(rig):
        at = np.asarray(camera.project(points)[0])
        seen = np.isfinite(at).all(axis=1)
        at, both = np.where(seen[:, None], at, 0), np.tile(np.where(seen, weight, 0), 2)
        width, height = camera.image_size
        _, _, radius = image_frame(camera.image_size)
        center = np.array([width - 1, height - 1]) / 2
        if camera.has_pose:
            center = np.asarray(camera.camera_matrix[:2, 2])
        x, y = ((at - center) / radius).T
        one, no = np.ones_like(x), np.zeros_like(x)

        def change(there: NDArray, camera=camera, at=at, seen=seen) -> NDArray:
            moved = np.where(seen[:, None], np.asarray(camera.project(there)[0]) - at, 0)
            return np.r_[moved[:, 0], moved[:, 1]]

        columns = [np.r_[one, no], np.r_[no, one], np.r_[-y, x], np.r_[x, y]]
        for axis in (camera.R[1], camera.R[0]):  # the scene turns the other way
            turned = points + angle * np.cross(points - middle, axis)
            columns.append(change(turned) / (angle * radius))
        basis = np.stack(columns, axis=1)
        if not camera.has_pose:
            basis[:, 2:4] = 0
        made = np.stack([change(there) for there in modes], axis=1)
        found[view] = np.linalg.lstsq(basis * both[:, None], made * both[:, None], rcond=1e-9)[0]
        images[view] = np.linalg.qr(basis * both[:, None])[1]
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


def _shortest(motion: NDArray[np.float64], modes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the motions less the scene's, of the least sum of lengths."""
    weight, left = np.ones(len(motion)), motion
    for _ in range(REWEIGHTINGS):
        left = _less(motion, modes, np.sqrt(weight)[:, None, None] * np.eye(motion.shape[1]))
        weight = 1 / np.sqrt((left**2).sum(axis=1) + FLOOR**2)
    return left


def _less(
    motion: NDArray[np.float64], modes: NDArray[np.float64], roots: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the motions less the scene's, of the least sum of ``|R t|²`` over the views."""
    flat = (roots @ modes).reshape(-1, modes.shape[2])
    whole = np.einsum("vij,vj->vi", roots, motion).ravel()
    return motion - modes @ np.linalg.lstsq(flat, whole, rcond=1e-9)[0]
