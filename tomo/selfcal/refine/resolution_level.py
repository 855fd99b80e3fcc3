"""One resolution level of a refinement: a step of the cameras and their held-out errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.selfcal.refine.first_volume import first_volume
from tomo.selfcal.refine.held_out import HeldOutErrors, predict_held_out, tiles_of
from tomo.selfcal.refine.joint_step import JointStep, weight_of
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
    images, masks : sequence of (height, width)
    trains : sequence of (height, width) bool
        The usable pixels that are not held out.
    grid : VoxelGrid
    active : ActiveVoxels
    chosen : tuple of int
        The cameras to move.
    lengths : (cameras, 8) float64
        Standard deviations of the priors.
    """

    rig: Rig
    images: Sequence[NDArray[np.float32]]
    masks: Sequence[NDArray[np.bool_]]
    training: Sequence[NDArray[np.bool_]]
    grid: VoxelGrid
    active: ActiveVoxels
    chosen: tuple[int, ...]
    lengths: NDArray[np.float64]

    def held_out_errors(self, parameters: NDArray[np.float64]) -> HeldOutErrors:
        """Return the errors of held-out rays with the cameras moved."""
        rig = moved_rig(self.rig, parameters)
        return predict_held_out(rig, self.images, self.masks, self.grid, self.active)

    def step(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of the parameters, ``(cameras, 8)``; zero for cameras not chosen."""
        rig = moved_rig(self.rig, parameters)
        system = LinearSystem.from_rig(rig, self.grid, masks=self.training, active=self.active)
        projector = system.projector
        counts = np.diff(projector.view_ptr)
        gain = np.repeat(np.exp(parameters[:, GAIN]), counts)
        measured = (system.flatten(self.images) / gain).astype(np.float32)
        volume = first_volume(projector, measured)
        values = volume.values
        predicted = np.asarray(projector @ values, np.float64)
        residual = measured - predicted
        gradient = volume_gradient(self.active.expand(values), self.grid)
        centers = self.grid.centers().reshape(-1, 3)[self.active.mask.ravel()]
        gradient = gradient[self.active.mask.ravel()]
        derivatives, weights, departures = [], [], []
        for view in self.chosen:
            block = projector.view(view)
            span = slice(*projector.view_ptr[view : view + 2])
            geometry = image_derivatives(lambda f, A=block: A @ f, rig[view], gradient, centers)
            scaled = np.vstack([geometry, predicted[span]]) * self.lengths[view][:, None]
            tiles = tiles_of(self.images[view].shape, COARSE_TILES).ravel()[system.pixels[view]]
            derivatives.append(scaled)
            weights.append(weight_of(scaled, residual[span], tiles))
            departures.append(parameters[view] / self.lengths[view])
        found = JointStep(
            volume.basis,
            volume.coefficients > DARK * volume.coefficients.max(initial=0.0),
            self.chosen,
            derivatives,
            np.array(weights),
            np.stack(departures),
        ).solve(residual)
        step = np.zeros_like(parameters)
        step[list(self.chosen)] = found * self.lengths[list(self.chosen)]
        return step
