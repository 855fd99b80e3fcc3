"""The gain of every view: its exposure, aperture and sensitivity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel
from tomo.model.effect import Prediction
from tomo.model.observation import Observation


@dataclass(frozen=True)
class Gain:
    """``b = exp(p) (A x)``: the logarithm of each view's gain.

    Parameters
    ----------
    sigma : float
        Prior standard deviation: exposures and lenses of one kind differ by some per cent.
    """

    sigma: float = 0.05
    name = "gain"
    parameters = ("gain",)
    units = ("",)
    shared = False
    positive = False
    of_cameras = False
    of_gas = False
    field_of = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ``A x``, ``(1, pixels)``."""
        return at.pixels[None]

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images over their gains."""
        gains = np.exp(values[:, 0])
        images = tuple(
            (image / g).astype(image.dtype)
            for image, g in zip(observation.images, gains, strict=True)
        )
        noise = tuple(
            NoiseModel(one.read / g, one.gain / g)
            for one, g in zip(observation.noise, gains, strict=True)
        )
        return replace(observation, images=images, noise=noise)
