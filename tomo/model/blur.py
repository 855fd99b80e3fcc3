"""The blur of a view: a lens out of focus, or a flame that moved while it was exposed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import laplace

from tomo.model.effect import Prediction
from tomo.model.observation import Observation


@dataclass(frozen=True)
class Blur:
    """``b = A x + p / 2 lap(A x)``: a blur of variance ``p``, in squared pixels, to first order.

    It is not taken out of images, where noise would grow, but put into the equations.

    Parameters
    ----------
    sigma : float
        Prior standard deviation: that of a blur by as many pixels as its root.
    """

    sigma: float = 2.0
    name = "blur"
    parameters = ("variance",)
    units = ("px²",)
    shared = False
    positive = True
    of_cameras = False
    of_gas = False
    field_of = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return half the Laplacian of the prediction, ``(1, pixels)``."""
        parts = [at.of_view(view, laplace(image)) for view, image in enumerate(at.images)]
        return np.concatenate(parts)[None] / 2

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation whose equations have the blur."""
        before = observation.blur or (0.0,) * len(values)
        blur = tuple(a + float(b) for a, b in zip(before, values[:, 0], strict=True))
        return replace(observation, blur=blur)
