"""Blocks of 4 x 4 pixels: the noise of a block's mean is a quarter of a pixel's."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIDE = 4
"""Pixels along each side of a block. Larger ones hide thin structure, single pixels are noise."""


def block_means(image: ArrayLike, usable: ArrayLike) -> NDArray[np.float64]:
    """Return the mean of every block whose pixels are all usable, ``(blocks,)``."""
    whole = blocks_of(np.asarray(usable, bool)).all(axis=1)
    return blocks_of(np.asarray(image, np.float64))[whole].mean(axis=1)


def blocks_of(image: NDArray) -> NDArray:
    """Return the pixels of an image's blocks, ``(blocks, 16)``; an odd border is left out."""
    rows, columns = (n // SIDE for n in image.shape)
    whole = image[: rows * SIDE, : columns * SIDE]
    return whole.reshape(rows, SIDE, columns, SIDE).swapaxes(1, 2).reshape(-1, SIDE * SIDE)
