"""The correlation of an image with a prediction, whatever small shift lies between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm

FEWEST_PIXELS = 50
"""Pixels in common. Fewer give no correlation."""


def agreement(
    predicted: Sequence[NDArray[np.floating]],
    image: NDArray[np.floating],
    mask: NDArray[np.bool_],
    reach: int,
) -> float:
    """Return the best correlation of an image with predictions, -1 to 1; NaN if too few pixels.

    Parameters
    ----------
    predicted : sequence of (rows, columns)
    image : (rows, columns)
    mask : (rows, columns) bool
        True where the image is compared.
    reach : int
        Shifts up to so many pixels along each side are tried.

    Notes
    -----
    Pearson's coefficient: a gain or an offset of the image changes nothing. A constant image or
    prediction has the correlation 0.
    """
    if not len(predicted):
        return math.nan
    predicted = np.asarray(predicted, np.float64)  # (predictions, rows, columns)
    found = [
        _largest_correlation(predicted[:, *at][:, mask[to]], image[to][mask[to]])
        for at, to in _overlaps(mask.shape, reach)
        if np.count_nonzero(mask[to]) >= FEWEST_PIXELS
    ]
    return max(found, default=math.nan)


def _largest_correlation(expected: NDArray[np.float64], shown: NDArray[np.floating]) -> float:
    """Return the largest correlation of predictions (predictions, pixels) with pixels."""
    expected = expected - expected.mean(axis=1, keepdims=True)
    shown = shown.astype(np.float64)
    shown -= shown.mean()
    size = np.sqrt(np.sum(expected**2, axis=1)) * norm(shown)
    product = np.sum(expected * shown, axis=1)
    return float(np.divide(product, size, out=np.zeros(len(size)), where=size > 0).max())


def _overlaps(shape: tuple[int, int], reach: int) -> Iterator[tuple[tuple, tuple]]:
    """Yield the slices of the prediction and of the image that overlap, for each shift."""
    rows, columns = shape

    def part(length: int, shift: int) -> slice:
        return slice(max(shift, 0), max(length + min(shift, 0), 0))

    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            yield (
                (part(rows, -down), part(columns, -right)),
                (part(rows, down), part(columns, right)),
            )
