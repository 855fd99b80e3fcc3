"""How well an image agrees with a prediction, wherever exactly the camera looked."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tomo._sums import dot, norm

FEWEST_PIXELS = 50
"""Fewer in common say nothing."""


def agreement(
    predicted: NDArray[np.floating],
    image: NDArray[np.floating],
    mask: NDArray[np.bool_],
    reach: int,
) -> float:
    """Return the best correlation of an image with a prediction, -1 to 1; NaN if too few pixels.

    Parameters
    ----------
    predicted, image : (rows, columns)
    mask : (rows, columns) bool
        Where the image takes part.
    reach : int
        The shifts that are tried: up to so many pixels along each side.

    Notes
    -----
    Pearson's coefficient: a gain or an offset of the image changes nothing. An image or a
    prediction of one value agrees with nothing: 0.
    """
    found = [
        _correlation(predicted[at], image[to][mask[to]], mask[to])
        for at, to in _overlaps(mask.shape, reach)
        if np.count_nonzero(mask[to]) >= FEWEST_PIXELS
    ]
    return max(found, default=math.nan)


def _correlation(
    predicted: NDArray[np.floating], shown: NDArray[np.floating], mask: NDArray[np.bool_]
) -> float:
    expected = predicted[mask].astype(np.float64)
    shown = shown.astype(np.float64)
    expected -= expected.mean()
    shown -= shown.mean()
    size = norm(expected) * norm(shown)
    return dot(expected, shown) / size if size > 0 else 0.0


def _overlaps(shape: tuple[int, int], reach: int) -> Iterator[tuple[tuple, tuple]]:
    """Return what of the prediction lies on what of the image, for each shift."""
    rows, columns = shape

    def part(length: int, shift: int) -> slice:
        return slice(max(shift, 0), max(length + min(shift, 0), 0))

    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            yield (
                (part(rows, -down), part(columns, -right)),
                (part(rows, down), part(columns, right)),
            )
