"""Squares of pixels: in their means white noise is a quarter of a pixel's."""

from __future__ import annotations

from numpy.typing import NDArray

SIDE = 4
"""Pixels along each side."""


def squares_of(image: NDArray) -> NDArray:
    """Return the pixels of an image's squares, ``(squares, 16)``; an odd border is left out."""
    rows, columns = (n // SIDE for n in image.shape)
    whole = image[: rows * SIDE, : columns * SIDE]
    return whole.reshape(rows, SIDE, columns, SIDE).swapaxes(1, 2).reshape(-1, SIDE * SIDE)
