"""The null: what effects seem to be where cameras are exact, on scenes like the one found."""

from __future__ import annotations

import zlib
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.model.observation import Observation
from tomo.operators import LinearSystem

FINER = 2
"""How much narrower than those of the fit the voxels of the null's volumes are."""

TURNS = ((), (0,), (2,), (0, 2), (1,), (0, 1))
"""Axes along which the found volume is turned over, one null each: scenes of the same kind that
meet voxels and cameras in other ways."""


class Exact(NamedTuple):
    """Images by exact cameras, the voxels that may be other than zero, and what they emit."""

    observation: Observation
    active: ActiveVoxels | None
    volume: NDArray[np.float32]  # (nx, ny, nz)


def exact_images(
    observation: Observation,
    volume: NDArray[np.float32],
    turn: int,
    active: ActiveVoxels | None = None,
    frame: int = 0,
) -> Exact:
    """Return what exact cameras see of a volume, turned over as `TURNS` says, with their noise.

    ``frame`` numbers the moments that are drawn with the same ``turn``.
    """
    grid = observation.grid
    fine = VoxelGrid.from_bounds([FINER * n for n in grid.shape], grid.lower, grid.upper)
    values = zoom(np.maximum(volume, 0), FINER, order=3, grid_mode=True, mode="nearest")
    values = np.flip(np.maximum(values, 0), TURNS[turn]).astype(np.float32)
    system = LinearSystem.from_rig(
        observation.rig, fine, masks=observation.masks, supersample=FINER, form="on-the-fly"
    )
    if observation.absorption:
        system = system.with_absorption(observation.absorption, values, supersample=FINER)
    seen = system.images(system.projector @ system.projector.active.compress(values))
    made = []
    for camera, image, noise in zip(observation.rig, seen, observation.noise, strict=True):
        seed = [turn, zlib.crc32(camera.name.encode())]
        random = np.random.default_rng(seed + [frame] * (frame > 0))
        spread = np.sqrt(noise.variance(image))
        made.append((image + random.normal(size=image.shape) * spread).astype(np.float32))
    if active is not None and not active.all:
        mask = np.flip(active.mask.reshape(grid.shape), TURNS[turn])
        active = ActiveVoxels.from_mask(grid, mask)
    turned = np.ascontiguousarray(np.flip(volume, TURNS[turn]))
    return Exact(replace(observation, images=tuple(made)), active, turned)
