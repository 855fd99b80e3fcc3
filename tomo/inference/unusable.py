"""Images that say nothing: a cap on the lens, one value all over, one file for two cameras."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel
from tomo.measurement.noise_model import SIDE, block_means

LIGHT = 4.5
"""Standard deviations of noise above which the brightest block, or all light together, is no
noise: of a thousand blocks of noise one is brighter by 3.3."""


def is_dark(image: NDArray[np.floating], mask: NDArray[np.bool_], noise: NoiseModel) -> bool:
    """Return whether an image has no light: one value all over, or noise alone.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel
    """
    values = image[mask]
    if not len(values) or values.max() == values.min():
        return True
    dark = float(np.median(values))
    spread = math.sqrt(float(noise.variance(dark)))
    light = np.asarray(values, np.float64) - dark
    means = block_means(np.asarray(image, np.float64), mask) - dark
    brightest = float(means.max(initial=0.0)) * SIDE
    return max(brightest, float(light.sum()) / math.sqrt(light.size)) < LIGHT * spread


def doubles(images: Sequence[NDArray[np.floating]]) -> list[tuple[int, int]]:
    """Return the pairs of images that are the same, pixel by pixel, and not dark."""
    return [
        (first, second)
        for second in range(len(images))
        for first in range(second)
        if images[first].shape == images[second].shape
        and images[first].any()
        and np.array_equal(images[first], images[second])
    ]
