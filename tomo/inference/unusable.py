"""Images that say nothing: a cap on the lens, one value all over, one file for two cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel
from tomo.measurement.pixel_blocks import SIDE, block_means

LIGHT = 8.0
"""Standard deviations of a block's mean above the image's median from which there is light."""


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
    means = block_means(np.asarray(image, np.float64), mask)
    if not len(means):
        return False
    spread = 1.4826 * float(np.median(np.abs(means - np.median(means))))
    spread = max(spread, noise.read / SIDE)
    return bool(np.max(means) - np.median(means) < LIGHT * spread) and spread > 0


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
