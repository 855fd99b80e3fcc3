"""The fall-off of lenses towards the corners of images: vignetting."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.model.effect import Prediction, image_frame
from tomo.model.observation import Observation


@dataclass(frozen=True)
class FallOff:
    """``b = (1 - p r²) (A x)``, with ``r`` one in the corners of an image.

    Parameters
    ----------
    sigma : float
        Prior standard deviation of the loss in the corners: that of usual lenses.
    """

    sigma: float = 0.2
    name = "fall-off"
    parameters = ("corners",)
    units = ("",)
    shared = True
    positive = True
    of_cameras = False
    of_gas = False
    field_of = None

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the prior standard deviations, ``(views, 1)``."""
        return np.full((len(observation.rig), 1), self.sigma)

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return ``-r² (A x)``, ``(1, pixels)``."""
        parts = [
            -at.of_view(view, image * squared_radius(camera.image_size))
            for view, (camera, image) in enumerate(zip(at.observation.rig, at.images, strict=True))
        ]
        return np.concatenate(parts)[None]

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the images over their fall-off."""
        images = tuple(
            (image / (1 - loss * squared_radius(camera.image_size))).astype(image.dtype)
            for camera, image, loss in zip(
                observation.rig, observation.images, values[:, 0], strict=True
            )
        )
        return replace(observation, images=images)


def squared_radius(size: tuple[int, int]) -> NDArray[np.float64]:
    """Return the squared distance of pixels from the image's middle, one in its corners: (h, w).

    ``size`` is (width, height).
    """
    x, y, radius = image_frame(size)
    width, height = size
    return (x**2 + y**2) * radius**2 / ((width / 2) ** 2 + (height / 2) ** 2)
