"""Gas that absorbs: a medium that fills the grid, and gas that absorbs its own light."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.model.effect import Prediction
from tomo.model.observation import Observation

STEP = 0.05
"""Optical depth of the difference that gives a column. Smaller, single precision shows; larger,
the exponential bends."""


@dataclass(frozen=True)
class Absorbing:
    """``A(p) x`` through gas of the optical depth ``p``.

    Parameters
    ----------
    own : bool
        Whether the gas absorbs its own light: ``p`` is the depth along the brightest line of
        sight. Else a medium fills the grid, and ``p`` is the depth across it.
    sigma : float
        Prior standard deviation of the depth.
    """

    own: bool
    sigma: float = 0.3
    parameters = ("depth",)
    units = ("",)
    shared = True
    positive = True
    of_cameras = False
    of_gas = True
    field_of = None

    @property
    def name(self) -> str:
        """What reports call it."""
        return "self-absorption" if self.own else "medium"

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return the difference of the prediction by a small depth, ``(1, pixels)``."""
        more = self.applied(at.observation, np.full((len(at.observation.rig), 1), STEP))
        active = at.system.projector.active
        means = at.system.projector.voxel_means(
            active.expand(at.unknowns).reshape(active.grid.shape)
        )
        several = {"supersample": at.observation.supersample}
        absorbing = at.system.with_absorption(more.absorption, means, **several)
        return (np.asarray(absorbing.projector @ at.unknowns, np.float64) - at.pixels)[None] / STEP

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation through gas that absorbs as much more."""
        depth = max(float(values.mean()), 0.0)
        gas = observation.absorption
        if self.own:
            more = replace(gas, emission=gas.emission + depth / observation.brightest)
        else:
            length = float(np.mean(observation.grid.extent))
            more = replace(gas, medium=gas.medium + depth / length)
        return replace(observation, absorption=more)
