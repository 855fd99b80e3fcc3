"""Squares of pixels: in their means white noise is a quarter of a pixel's."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIDE = 4
"""Pixels along each side."""


def means_of_squares(image: ArrayLike, usable: ArrayLike) -> NDArray[np.float64]:
    """Return the mean of every square of an image whose pixels are all usable."""
    whole = squares_of(np.asarray(usable, bool)).all(axis=1)
    return squares_of(np.asarray(image, np.float64))[whole].mean(axis=1)


def squares_of(image: NDArray) -> NDArray:
    """Return the pixels of an image's squares, ``(squares, 16)``; an odd border is left out."""
    rows, columns = (n // SIDE for n in image.shape)
    whole = image[: rows * SIDE, : columns * SIDE]
    return whole.reshape(rows, SIDE, columns, SIDE).swapaxes(1, 2).reshape(-1, SIDE * SIDE)
