"""One resolution level of a refinement: a step of the cameras and their held-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import matmul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.selfcal.refine.first_volume import first_volume
from tomo.selfcal.refine.held_out import (
    HeldOutErrors,
    predict_held_out,
    tiles_of,
    training_pixels,
)
from tomo.selfcal.refine.joint_step import JointStep, SeenMoment, weight_of
from tomo.selfcal.refine.moment import Moment
from tomo.selfcal.refine.parameters import GAIN, image_derivatives, moved_rig, volume_gradient

COARSE_TILES = 8
"""Tiles along an image's shorter side within which residuals count as correlated. More tiles trust
correlated residuals too much; fewer hold cameras at the prior."""

DARK = 1e-3
"""Fraction of the brightest coefficient below which a voxel stays dark. Higher, faint parts cannot
change; lower, empty voxels absorb camera errors."""


@dataclass(frozen=True, eq=False)
class Level:
    """Cameras, images and grid at one resolution.

    Attributes
    ----------
    rig : Rig
        The cameras as given, before they are moved by parameters.
    moments, judges : sequence of Moment
        Those that the cameras are refined from, and those whose held-out rays decide.
    grid : VoxelGrid
    active : ActiveVoxels
    chosen : tuple of int
        The cameras to move.
    lengths : (cameras, 8) float64
        Standard deviations of the priors.
    """

    rig: Rig
    moments: Sequence[Moment]
    judges: Sequence[Moment]
    grid: VoxelGrid
    active: ActiveVoxels
    chosen: tuple[int, ...]
    lengths: NDArray[np.float64]

    def held_out_errors(self, parameters: NDArray[np.float64]) -> HeldOutErrors:
        """Return the errors of held-out rays with the cameras moved."""
        rig = moved_rig(self.rig, parameters)
        return predict_held_out(rig, self.judges, self.grid, self.active)

    def step(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of the parameters, ``(cameras, 8)``; zero for cameras not chosen."""
        rig = moved_rig(self.rig, parameters)
        masks = training_pixels(self.moments)
        system = LinearSystem.from_rig(rig, self.grid, masks=masks, active=self.active)
        gain = np.repeat(np.exp(parameters[:, GAIN]), np.diff(system.projector.view_ptr))
        basis: Any = None
        seen, residuals = [], []
        for moment in self.moments:
            measured = (system.flatten(moment.images) / gain).astype(np.float32)
            volume = first_volume(system.projector, measured)
            predicted = np.asarray(system.projector @ volume.values, np.float64)
            basis, residual = volume.basis, measured - predicted
            free = volume.coefficients > DARK * volume.coefficients.max(initial=0.0)
            seen.append(SeenMoment(free, self._derivatives(rig, system, volume.values, predicted)))
            residuals.append(residual)
        own = list(self.chosen)
        weights = [self._weight(system, number, seen, residuals) for number in range(len(own))]
        found = JointStep(
            basis, self.chosen, seen, np.array(weights), (parameters / self.lengths)[own]
        ).solve(residuals)
        step = np.zeros_like(parameters)
        step[own] = found * self.lengths[own]
        return step

    def _derivatives(
        self,
        rig: Rig,
        system: LinearSystem,
        values: NDArray[np.float32],
        predicted: NDArray[np.float64],
    ) -> list[NDArray[np.float64]]:
        """Return the scaled derivatives ``(8, pixels)`` of each chosen view's prediction."""
        lit = self.active.mask.ravel()
        gradient = volume_gradient(self.active.expand(values), self.grid)[lit]
        centers = self.grid.centers().reshape(-1, 3)[lit]
        found = []
        for view in self.chosen:
            block = system.projector.view(view)
            span = slice(*system.projector.view_ptr[view : view + 2])
            geometry = image_derivatives(partial(matmul, block), rig[view], gradient, centers)
            found.append(np.vstack([geometry, predicted[span]]) * self.lengths[view][:, None])
        return found

    def _weight(
        self,
        system: LinearSystem,
        number: int,
        seen: Sequence[SeenMoment],
        residuals: Sequence[NDArray[np.float64]],
    ) -> float:
        """Return the weight of a chosen view's prior; a tile counts as one at all moments."""
        view = self.chosen[number]
        span = slice(*system.projector.view_ptr[view : view + 2])
        shape = self.moments[0].images[view].shape
        tiles = tiles_of(shape, COARSE_TILES).ravel()[system.pixels[view]]
        return weight_of(
            np.hstack([each.derivatives[number] for each in seen]),
            np.concatenate([residual[span] for residual in residuals]),
            np.tile(tiles, len(seen)),
        )
