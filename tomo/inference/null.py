"""The null: what effects seem to be where cameras are exact, on scenes like the one found."""

from __future__ import annotations

import zlib
from dataclasses import replace

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


def exact_images(
    observation: Observation,
    volume: NDArray[np.float32],
    turn: int,
    active: ActiveVoxels | None = None,
) -> tuple[Observation, ActiveVoxels | None, NDArray[np.float32]]:
    """Return the observation with images of a volume by exact cameras, and their noise.

    The volume, and with it the active voxels, is turned over as `TURNS` says; both are returned
    too.
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
        random = np.random.default_rng([turn, zlib.crc32(camera.name.encode())])
        spread = np.sqrt(noise.variance(image))
        made.append((image + random.normal(size=image.shape) * spread).astype(np.float32))
    if active is not None and not active.all:
        mask = np.flip(active.mask.reshape(grid.shape), TURNS[turn])
        active = ActiveVoxels.from_mask(grid, mask)
    turned = np.ascontiguousarray(np.flip(volume, TURNS[turn]))
    return replace(observation, images=tuple(made)), active, turned
