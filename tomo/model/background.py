"""The background of every view: what its pixels show beside the light of the volume."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.model.effect import Prediction
from tomo.model.observation import Observation


@dataclass(frozen=True)
class Background:
    """``b = A x + p``: a level in the unit of the images.

    Parameters
    ----------
    sigma : float
        Prior standard deviation, a fraction of the brightest light: dark levels drift by less.
    """

    sigma: float = 0.01
    name = "background"
    parameters = ("level",)
    units = ("image",)
    shared = False
    positive = True
    of_cameras = False
    of_gas = False
    field_of = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma * observation.brightest)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ones, ``(1, pixels)``."""
        return np.ones((1, len(at.pixels)))

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images less their levels."""
        images = tuple(
            (image - level).astype(image.dtype)
            for image, level in zip(observation.images, values[:, 0], strict=True)
        )
        return replace(observation, images=images)
