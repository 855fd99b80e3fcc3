"""Dark regions below zero, as where too much was subtracted as dark."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.measurement.noise_model import NoiseModel
from tomo.measurement.pixel_blocks import SIDE, block_means

SIGMAS = 4.0  # standard deviations of a block's mean below zero that count
FRACTION = 0.005  # fraction of the brightest block, added to that limit
AREA = 0.02
"""Fraction of the blocks that must lie below zero; fewer can be chance."""


def below_zero(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the median depth of the blocks below zero, in image units; 0 for none.

    Emission is never negative, so a dark region is zero within the noise.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel
        The image's noise.

    Notes
    -----
    A block of 4 x 4 usable pixels lies below zero when its mean is below minus four of its
    standard deviations minus 0.5 % of the brightest block. Noise explains up to 2 % of such
    blocks; beyond that the median of their means is returned, as a positive number.
    """
    means = block_means(image, mask)
    if not means.size:
        return 0.0
    far = SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + FRACTION * max(means.max(), 0.0)
    below = means[means < -far]
    return float(-np.median(below)) if len(below) > AREA * means.size else 0.0
