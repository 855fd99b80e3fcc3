"""Non-finite, dead and hot single pixels that no mask marks."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.measurement.noise_model import NoiseModel

SIGMAS = 8.0  # standard deviations beyond the brightest or darkest neighbour
FRACTION = 0.05  # fraction of the image's maximum beyond that neighbour
TIMES = 4.0  # factor to the nearest of the neighbours' values
_DOWN, _RIGHT = (-1, -1, -1, 0, 0, 1, 1, 1), (-1, 0, 1, -1, 1, -1, 0, 1)  # to the neighbours


def usable_pixels(
    image: ArrayLike, mask: ArrayLike | None = None, noise: NoiseModel | None = None
) -> NDArray[np.bool_]:
    """Return the pixels of an image that can be trusted, ``(height, width)``.

    A scan's corrections put masks and saturation into ``mask``; this finds what remains.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool, optional
        True where a pixel is usable as far as is known.
    noise : NoiseModel, optional
        No noise when None.

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
    untrusted = None if usable.all() else ~usable
    shown = image if untrusted is None else image[usable]
    largest = float(shown.max(initial=0.0))
    if largest <= 0 or min(image.shape) < 3:
        return usable
    # One neighbour rules out nearly all pixels; the other seven are read for the rest alone.
    high, low = _of_one_neighbour(image, untrusted)
    found = np.nonzero(_is_outlier(image, high, low, np.float32(FRACTION * largest)) & usable)
    if not len(found[0]):
        return usable
    high = _of_neighbours(np.where(usable, image, -np.inf), found, np.maximum)
    low = _of_neighbours(np.where(usable, image, np.inf), found, np.minimum)
    few = _is_outlier(image[found], high, low, np.float32(FRACTION * largest)) & np.isfinite(low)
    found, high, low = tuple(axis[few] for axis in found), high[few], low[few]
    noise = NoiseModel(0.0) if noise is None else noise
    sigma = np.sqrt(noise.variance(np.maximum(low, 0)))
    far = np.maximum(SIGMAS * sigma, FRACTION * largest)
    usable[found] = ~_is_outlier(image[found], high, low, far)
    return usable


def _is_outlier(
    image: NDArray[np.float32],
    high: NDArray[np.float32],
    low: NDArray[np.float32],
    far: NDArray[np.floating] | np.float32,
) -> NDArray[np.bool_]:
    """Return which pixels are so far above or below their neighbours."""
    with np.errstate(invalid="ignore"):
        # Dividing the image instead of multiplying the neighbour cannot overflow.
        hot = image / TIMES > np.abs(high) + far / TIMES
        # A quarter of a negative value is brighter, not darker.
        return hot | (image < np.minimum(low, low / TIMES) - far)


def _of_one_neighbour(
    image: NDArray[np.float32], untrusted: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return bounds of the magnitude of the highest, and of the lowest, neighbour of each pixel.

    From below and from above, by the neighbour in the next row, in the last row by that before;
    one that cannot be trusted, where there are such, bounds nothing.
    """
    other = np.concatenate([image[1:], image[-2:-1]])
    if untrusted is None:
        return np.maximum(other, 0), other
    excluded = np.concatenate([untrusted[1:], untrusted[-2:-1]])
    return (
        np.maximum(np.where(excluded, np.float32(0), other), 0),
        np.where(excluded, np.float32(np.inf), other),
    )


def _of_neighbours(
    image: NDArray[np.float32], places: tuple[NDArray[np.int64], ...], extreme: np.ufunc
) -> NDArray[np.float32]:
    """Return the extreme of the eight neighbours of pixels at (row, column), fewer on the border.

    ``places`` are the rows (N,) and columns (N,).
    """
    excluded = -np.inf if extreme is np.maximum else np.inf
    padded = np.pad(image, 1, constant_values=excluded)
    row, column = (axis[:, None] + 1 for axis in places)
    return extreme.reduce(padded[row + _DOWN, column + _RIGHT], axis=1)
