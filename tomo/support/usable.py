"""Pixels that are no measurement though no mask says so: NaN, dead and hot single pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.support.noise_model import NoiseModel

SIGMAS = 8.0  # beyond the brightest or darkest neighbour
SHARE = 0.05  # of the image's maximum, likewise
TIMES = 4.0  # brighter or darker than the nearest of its neighbours


def usable_pixels(
    image: ArrayLike, mask: ArrayLike | None = None, noise: NoiseModel | None = None
) -> NDArray[np.bool_]:
    """Return the pixels of an image that can be trusted, ``(height, width)``.

    Masks, saturation and flat fields are a scan's corrections and already in ``mask``; this finds
    what they leave.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool, optional
        True where a pixel is usable as far as is known.
    noise : NoiseModel, optional
        None knows of no noise.

    Notes
    -----
    A single pixel is dead or hot when it is four times darker or brighter than all of its eight
    usable neighbours (below zero: darker), and more than eight standard deviations and a twentieth
    of the image's maximum beyond that: lenses spread what is real over more than one pixel. Pixels
    on the image's border are judged by the neighbours that they have.
    """
    image = np.asarray(image, np.float32)
    usable = np.isfinite(image)
    if mask is not None:
        usable &= np.asarray(mask, bool)
    largest = float(image.max(initial=0.0, where=usable))
    if largest <= 0 or min(image.shape) < 3:
        return usable
    high = _of_neighbours(np.where(usable, image, -np.inf), np.maximum)
    low = _of_neighbours(np.where(usable, image, np.inf), np.minimum)
    few = _strange(image, high, low, np.float32(SHARE * largest)) & usable & np.isfinite(low)
    found = np.nonzero(few)
    if not len(found[0]):
        return usable
    noise = NoiseModel(0.0) if noise is None else noise
    image, high, low = image[found], high[found], low[found]
    sigma = np.sqrt(noise.variance(np.maximum(low, 0)))
    usable[found] = ~_strange(image, high, low, np.maximum(SIGMAS * sigma, SHARE * largest))
    return usable


def _strange(
    image: NDArray[np.float32],
    high: NDArray[np.float32],
    low: NDArray[np.float32],
    far: NDArray[np.floating] | np.float32,
) -> NDArray[np.bool_]:
    """Return which pixels are so far above or below their neighbours."""
    with np.errstate(invalid="ignore"):
        # The image is divided rather than a bright neighbour multiplied: 1e38 is a number too.
        hot = image / TIMES > np.abs(high) + far / TIMES
        # A quarter of what is below zero is brighter, not darker.
        return hot | (image < np.minimum(low, low / TIMES) - far)


def _of_neighbours(image: NDArray[np.float32], extreme: np.ufunc) -> NDArray[np.float32]:
    """Return the extreme of each pixel's eight neighbours, fewer on the border."""
    nothing = -np.inf if extreme is np.maximum else np.inf
    padded = np.full((image.shape[0] + 2, image.shape[1] + 2), nothing, image.dtype)
    padded[1:-1, 1:-1] = image
    rows = extreme(padded[:-2], padded[2:])  # above and below
    three = extreme(rows, padded[1:-1])
    sides = extreme(three[:, :-2], three[:, 2:])
    return extreme(sides, rows[:, 1:-1])
