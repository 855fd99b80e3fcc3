"""Images that lie below zero, as where too much was subtracted as dark."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.support.noise_model import NoiseModel

SIDE = 4
"""Pixels along each side of the squares whose means are looked at: noise is a quarter in them."""

SIGMAS = 4.0  # of the noise of such a mean
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
    means = _means_of_squares(np.asarray(image, np.float64), np.asarray(mask, bool))
    if not means.size:
        return 0.0
    far = SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + SHARE * max(means.max(), 0.0)
    below = means[means < -far]
    return float(-np.median(below)) if len(below) > AREA * means.size else 0.0


def _means_of_squares(image: NDArray[np.float64], usable: NDArray[np.bool_]) -> NDArray:
    """Return the means of the squares that are usable whole, ``(squares,)``."""
    rows, columns = (n // SIDE for n in image.shape)

    def squares(array: NDArray) -> NDArray:
        whole = array[: rows * SIDE, : columns * SIDE]
        return whole.reshape(rows, SIDE, columns, SIDE).swapaxes(1, 2).reshape(-1, SIDE * SIDE)

    return squares(image)[squares(usable).all(axis=1)].mean(axis=1)
