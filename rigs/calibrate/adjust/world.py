"""The world axes of a finished rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.calibrate.adjust.observation_arrays import Scene
from rigs.geometry.rotation import POORLY_MET, are_on_a_line, motion_between, numbers


def in_world(
    scene: Scene,
    cameras: tuple[str, ...],
    frames: tuple[str, ...],
    world: str | Mapping[str, ArrayLike] | None,
    rescale: bool,
) -> tuple[Scene, str, float, tuple[str, ...]]:
    """Return the scene in the user's world, that in words, the growth of lengths, and warnings.

    ``world`` and ``rescale`` are those of `rigs.calibrate.calibrate`, checked by `check_options`.
    """
    if isinstance(world, Mapping):
        return _aligned(scene, cameras, frames, world, rescale)
    name = cameras[0] if world is None else world
    if name in cameras:
        index = cameras.index(name)
        R, t = scene.camera_R[index], scene.camera_t[index]
        world_frame = f"axes of camera {name}: origin in its centre, x right, y down, z forward"
    else:
        index = _posed_frame(scene, frames, name)
        R, t = scene.target_R[index].T, -scene.target_R[index].T @ scene.target_t[index]
        world_frame = (
            f"axes of the target in frame {name}: origin in its point (0, 0, 0), z its normal"
        )
    return _moved(scene, R, t, 1.0), world_frame, 1.0, ()


def _aligned(
    scene: Scene,
    cameras: tuple[str, ...],
    frames: tuple[str, ...],
    world: Mapping[str, ArrayLike],
    rescale: bool,
) -> tuple[Scene, str, float, tuple[str, ...]]:
    """Return the scene moved onto given positions in the least-squares sense."""
    targets, places = [], []
    for name, position in world.items():
        targets.append(numbers(position, (3,), f"world: {name}"))
        if name in cameras:
            index = cameras.index(name)
            places.append(-scene.camera_R[index].T @ scene.camera_t[index])
        else:
            places.append(scene.target_t[_posed_frame(scene, frames, name)])
    given, found = np.reshape(targets, (-1, 3)), np.reshape(places, (-1, 3))
    for points in (given, found):
        if are_on_a_line(points):
            raise ValueError(f"world: found {len(points)} positions, expected 3 not on a line")
    R, t, size = motion_between(found, given, rescale)
    misfit = np.sqrt((((size * found @ R.T + t) - given) ** 2).sum(axis=1).mean())
    extent = np.sqrt(((given - given.mean(axis=0)) ** 2).sum(axis=1).mean())
    world_frame = f"given positions of {', '.join(world)}, met within {misfit:.3g} RMS"
    world_frame += ", which set the scale" if rescale else ""
    warning = (
        f"world: the given positions are met within {misfit:.3g} only, "
        f"{100 * misfit / extent:.0f} % of their distance from their middle: check that they are "
        f"in {'one' if rescale else 'the same'} length unit, of these cameras and frames, and not "
        "mirrored",
    )
    return (
        _moved(scene, R, t, size),
        world_frame,
        size,
        warning if misfit > POORLY_MET * extent else (),
    )


def _posed_frame(scene: Scene, frames: tuple[str, ...], name: str) -> int:
    """Return the index of the frame called ``name``."""
    index = frames.index(name)
    if not np.isfinite(scene.target_t[index]).all():
        raise ValueError(f"world: frame {name}: found no pose of the target in it")
    return index


def _moved(scene: Scene, R: NDArray, t: NDArray, size: float) -> Scene:
    """Return the scene after ``x_new = size R x_old + t`` of its world."""
    camera_R = scene.camera_R @ R.T
    bending = scene.refraction
    return replace(
        scene,
        refraction=bending and bending.with_lengths_scaled(size).transformed(R, t),
        camera_R=camera_R,
        camera_t=size * scene.camera_t - camera_R @ t,
        target_R=R @ scene.target_R,
        target_t=size * scene.target_t @ R.T + t,
    )
