"""The noise of a camera, estimated from one image: read-out and photon noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import golden_ratio_sequence
from tomo._compute.jit import compiled

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


PIXELS_A_LEVEL = 400  # pixels; fewer leave the spread of a level uncertain by more than 8 %
MOST_LEVELS = 20  # grey levels of the fit; more change nothing
QUARTER_OF_A_NORMAL = round(NormalDist().inv_cdf(5 / 8), 6)  # the lower quartile of |N(0, 1)|
REWEIGHTINGS = 4  # of the straight line; it has settled by then


@dataclass(frozen=True)
class NoiseModel:
    """The noise of a camera: ``variance = read^2 + gain * signal``.

    Attributes
    ----------
    read : float
        Standard deviation in the dark, in the image's units.
    gain : float
        Image units per detected photon: the slope of the variance over the signal.

    Raises
    ------
    ValueError
        If one is negative or not finite.
    """

    read: float
    gain: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("read", "gain"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(f"noise {name}: found {value}, expected a finite number >= 0")

    def variance(self, image: ArrayLike) -> NDArray[np.float64]:
        """Return the variance of every pixel, in image units squared.

        Values below zero count as dark.
        """
        return self.read**2 + self.gain * np.maximum(np.asarray(image, np.float64), 0)


def estimate_noise(
    image: ArrayLike, mask: ArrayLike | None = None, expected: ArrayLike | None = None
) -> NoiseModel:
    """Estimate the noise of a camera from an image.

    ``expected`` (height, width) is the image without noise as far as it is known, such as a
    re-projected volume. Its fine structure is not taken for noise, and it gives the signal.
    ``mask`` is True where a pixel is usable. ValueError: they have another shape than the image.

    The 3 x 3 filter ``[1 -2 1]^T [1 -2 1] / 6`` keeps the variance of white noise and removes
    everything linear along rows or columns. Its output does not correlate with the mean of the
    same nine pixels, by which pixels are sorted into levels of equal count. In each level the
    lower quartile of the filter's magnitude gives the spread: edges and fine structure, which only
    enlarge the magnitude, hardly change it. A line of non-negative intercept and slope through
    (mean, spread^2), weighted by the line itself, gives ``read`` and ``gain``.

    Blocks with two or more pixels of exactly zero are skipped: their noise was clipped. The filter
    is that of Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding
    64 (1996).
    """
    image = np.asarray(image)
    for name, other in (("mask", mask), ("expected", expected)):
        if other is not None and np.shape(other) != image.shape:
            raise ValueError(
                f"{name}: found shape {np.shape(other)}, expected {image.shape}, the image's"
            )
    if image.ndim != 2 or min(image.shape) < 3:
        return NoiseModel(0.0)
    same = expected is None or np.asarray(expected).dtype == image.dtype
    kind = image.dtype if same and image.dtype in (np.float32, np.float64) else np.float64
    image = np.ascontiguousarray(image, kind)
    signal = image if expected is None else np.ascontiguousarray(expected, kind)
    usable = np.zeros((0, 0), bool) if mask is None else np.ascontiguousarray(mask, bool)
    level, fine = _nines(image, usable, signal, expected is not None)
    if not len(level):
        return NoiseModel(0.0)
    most = PIXELS_A_LEVEL * MOST_LEVELS
    if len(level) > most:  # evenly spread, in step with no row
        some = golden_ratio_sequence(len(level)) < most / len(level)
        level, fine = level[some], fine[some]
    parts = min(max(len(level) // PIXELS_A_LEVEL, 1), MOST_LEVELS)
    # Sorting all is quicker than finding the bounds of the levels.
    order = np.argsort(level)[len(level) % parts :].reshape(parts, -1)
    means = level[order].mean(axis=1)
    quarter = order.shape[1] // 4
    spreads = np.partition(fine[order], quarter, axis=1)[:, quarter]
    return NoiseModel(*_line(means, (spreads / QUARTER_OF_A_NORMAL) ** 2))


@compiled()
def _nines(image, mask, signal, takes_away):
    """Return the mean of ``signal`` and the filter's magnitude for every valid 3 x 3 block.

    A block is valid where all pixels are usable (``mask``; all where it is empty) and at most one
    is zero. ``takes_away``: the filter is applied to the image less the signal.
    """
    height, width = image.shape
    most = (height - 2) * (width - 2)
    level, fine, count = np.zeros(most), np.zeros(most), 0
    # per column of three pixels: 1 for each zero, 2 for each unusable one; their sum; the filter
    against, total, down = np.zeros(width, np.int64), np.zeros(width), np.zeros(width)
    share = 1.0 if takes_away else 0.0
    for row in range(height - 2):
        for column in range(width):
            high, even, low = image[row, column], image[row + 1, column], image[row + 2, column]
            zeros = (high == 0) + (even == 0) + (low == 0)
            strange = (high - high != 0) + (even - even != 0) + (low - low != 0)  # not finite
            against[column] = zeros + 2 * strange
            top, middle, bottom = (
                np.float64(signal[row, column]),
                np.float64(signal[row + 1, column]),
                np.float64(signal[row + 2, column]),
            )
            total[column] = top + middle + bottom
            outer = (high - share * top) + (low - share * bottom)
            down[column] = outer - 2 * (even - share * middle)
        if mask.size > 0:
            for column in range(width):
                for below in range(3):
                    against[column] += 2 * (not mask[row + below, column])
        for column in range(width - 2):
            level[count] = (total[column] + total[column + 1] + total[column + 2]) / 9
            fine[count] = abs(down[column] - 2 * down[column + 1] + down[column + 2]) / 6
            count += against[column] + against[column + 1] + against[column + 2] < 2
    return level[:count], fine[:count]


@compiled()
def _line(level, variance):
    """Return read-out noise and gain fitted to ``variance`` (n,) at ``level`` (n,).

    Residuals are weighted by the inverse of the variance that the line itself gives.
    """
    count = len(level)
    mean = intercept = slope = 0.0
    for n in range(count):
        mean += variance[n] / count
    expected = np.full(count, mean)
    for _ in range(REWEIGHTINGS):
        largest = 0.0
        for n in range(count):
            largest = max(largest, expected[n])
        if largest == 0:
            return 0.0, 0.0
        total = x = y = along = across = 0.0
        for n in range(count):
            weight = 1 / max(expected[n], 1e-6 * largest) ** 2
            total += weight
            x += weight * max(level[n], 0.0)
            y += weight * variance[n]
        x, y = x / total, y / total
        spread = leaning = 0.0
        for n in range(count):
            weight, at = 1 / max(expected[n], 1e-6 * largest) ** 2, max(level[n], 0.0)
            spread += weight * (at - x) ** 2
            leaning += weight * (at - x) * (variance[n] - y)
            across += weight * at * variance[n]
            along += weight * at**2
        slope = max(leaning / spread, 0.0) if spread > 0 else 0.0
        intercept = y - slope * x
        if intercept < 0:
            intercept, slope = 0.0, across / along
        for n in range(count):
            expected[n] = intercept + slope * max(level[n], 0.0)
    return math.sqrt(intercept), slope
