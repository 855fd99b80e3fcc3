"""Images that lie below zero, as where too much was subtracted as dark."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.measurement.noise_model import NoiseModel
from tomo.measurement.pixel_blocks import SIDE, means_of_squares

SIGMAS = 4.0  # of the noise of a square's mean
SHARE = 0.005  # of the image's brightest light, likewise
AREA = 0.02
"""Share of the squares that must lie so far below zero before anything is said."""


def below_zero(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return how far the part of an image below zero lies there, in the middle; 0 for none.

    Emission is never negative, so a dark region is zero within the noise.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel
        Of the image.

    Notes
    -----
    Squares of 4 x 4 usable pixels lie below zero when their mean does by four of its standard
    deviations and half a per cent of the brightest square. Where a fiftieth of all squares do,
    no noise explains it, and the median of their means is returned, as a positive number.
    """
    means = means_of_squares(image, mask)
    if not means.size:
        return 0.0
    far = SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + SHARE * max(means.max(), 0.0)
    below = means[means < -far]
    return float(-np.median(below)) if len(below) > AREA * means.size else 0.0
