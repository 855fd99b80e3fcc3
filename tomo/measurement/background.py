"""Offsets of an image: a uniform background, or dark regions below zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.measurement.noise_model import SIDE, NoiseModel, block_means

SIGMAS = 5.0  # standard deviations of a block's mean that the background must exceed
FRACTION = 0.01  # fraction of the brightest block, added to that limit

FLOOR = (0.02, 0.2)
"""Quantiles of the blocks' means between which a uniform background is flat; emission fades."""

FLAT = 0.05
"""Fraction of the background by which the two quantiles may differ, besides their noise."""

BELOW_SIGMAS = 4.0  # standard deviations of a block's mean below zero that count
BELOW_FRACTION = 0.005  # fraction of the brightest block, added to that limit
BELOW_AREA = 0.02
"""Fraction of the blocks that must lie below zero; fewer can be chance."""


def background(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the level of an image's uniform background, in image units; 0 for none.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel
        The image's noise.

    Notes
    -----
    Blocks of 4 x 4 usable pixels are averaged. There is a background where the 2 % quantile of
    the means exceeds five standard deviations of a mean plus 1 % of the brightest block, and
    the 2 % and 20 % quantiles differ by at most three standard deviations plus 5 %.
    """
    means = block_means(image, mask)
    if not means.size:
        return 0.0
    lowest, level = np.quantile(means, FLOOR).tolist()
    sigma = float(np.sqrt(noise.variance(max(level, 0.0)))) / SIDE
    if lowest <= SIGMAS * sigma + FRACTION * means.max():
        return 0.0
    return level if level - lowest <= 3 * sigma + FLAT * level else 0.0


def below_zero(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the median depth of the blocks below zero, in image units; 0 for none.

    Emission is never negative, so a dark region is zero within the noise.

    Takes what `background` takes.

    Notes
    -----
    A block of 4 x 4 usable pixels lies below zero when its mean is below minus four of its
    standard deviations minus 0.5 % of the brightest block. Noise explains up to 2 % of such
    blocks; beyond that the median of their means is returned, as a positive number.
    """
    means = block_means(image, mask)
    if not means.size:
        return 0.0
    far = BELOW_SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + BELOW_FRACTION * max(
        means.max(), 0.0
    )
    below = means[means < -far]
    return float(-np.median(below)) if len(below) > BELOW_AREA * means.size else 0.0
