"""Images that lie on an even background, as where no dark frame was subtracted."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.measurement.noise_model import NoiseModel
from tomo.measurement.pixel_blocks import SIDE, means_of_squares

SIGMAS = 5.0  # of the noise of a square's mean
SHARE = 0.01  # of the image's brightest light, likewise

FLOOR = (0.02, 0.2)
"""Shares of the squares, the darkest first, between which an even background shows: it lies below
all emission, which fades."""

EVEN = 0.05
"""Of the background, by which these may differ, beside their noise."""


def background(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the level of the even background that an image lies on; 0 for none.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel
        Of the image.

    Notes
    -----
    Of the means of squares of 4 x 4 usable pixels, the second and the twentieth per cent, from
    the darkest on, lie above zero by five standard deviations of a mean and one per cent of the
    brightest square, and differ by no more than three standard deviations and a twentieth.
    """
    means = means_of_squares(image, mask)
    if not means.size:
        return 0.0
    lowest, level = np.quantile(means, FLOOR).tolist()
    sigma = float(np.sqrt(noise.variance(max(level, 0.0)))) / SIDE
    if lowest <= SIGMAS * sigma + SHARE * means.max():
        return 0.0
    return level if level - lowest <= 3 * sigma + EVEN * level else 0.0
