"""Pixels that are no measurement though no mask says so: NaN, dead and hot single pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compile import compiled
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
    image = np.ascontiguousarray(image, np.float32)
    usable = np.isfinite(image)
    if mask is not None:
        usable &= np.asarray(mask, bool)
    if min(image.shape) < 3:
        return usable
    found = np.zeros_like(usable)
    read, gain = (0.0, 0.0) if noise is None else (noise.read, noise.gain)
    _judge(image, usable, read, gain, found)
    return found


@compiled()
def _judge(image, usable, read, gain, found):
    """Write to ``found`` which usable pixels (height, width) are neither dead nor hot."""
    height, width = image.shape
    bits, largest = image.view(np.int32), 0  # in the order of the floats where these are above 0
    for row in range(height):
        for column in range(width):
            largest = max(largest, bits[row, column] if usable[row, column] else 0)
    if largest == 0:
        found[:] = usable
        return
    least = SHARE * np.float64(np.array([largest], np.int32).view(np.float32)[0])
    for row in range(height):
        # what one neighbour speaks against need not be asked of the others: hardly any is left
        beside = row + 1 if row + 1 < height else row - 1
        for column in range(width):
            value, other = np.float64(image[row, column]), np.float64(image[beside, column])
            fits = not _is_strange(value, max(other, 0.0), other, least)
            found[row, column] = usable[row, column] & usable[beside, column] & fits
        for column in range(width):
            if found[row, column] or not usable[row, column]:
                continue
            high, low = -np.inf, np.inf
            for y in range(max(row - 1, 0), min(row + 2, height)):
                for x in range(max(column - 1, 0), min(column + 2, width)):
                    if usable[y, x] and not (y == row and x == column):
                        high = max(high, np.float64(image[y, x]))
                        low = min(low, np.float64(image[y, x]))
            sigma = math.sqrt(read**2 + gain * max(low, 0.0))
            far = max(SIGMAS * sigma, least)
            is_alone = low == np.inf
            found[row, column] = is_alone or not _is_strange(
                np.float64(image[row, column]), abs(high), low, far
            )


@compiled(inline=True)
def _is_strange(value, high, low, far):
    """Whether a pixel is so far above the magnitude ``high``, or below ``low``.

    A quarter of what is below zero is brighter, not darker.
    """
    return (value / TIMES > high + far / TIMES) | (value < min(low, low / TIMES) - far)
