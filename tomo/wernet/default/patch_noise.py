"""How much of the patches' misfit is noise, which no weights explain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ORDER = 5
"""Of the differences of pixels that noise is known by. A turbulent flame whose clean pixels are
half a voxel leaves 8e-4 of its brightest in third ones, 2e-4 in fifth; of 2 % of noise third ones
make 2.01 to 2.07 %, fifth ones 2.00 to 2.01 %."""

NORMAL_MEDIAN = 0.6745
"""Of the absolute values of a normal deviate."""

OVERLAP = 1.27
"""By how much the squares of white noise, summed over patches that overlap, vary more than those
of patches that do not: neighbours share a quarter of it, in each direction."""

SURE = 2.0
"""Standard deviations of the noise's own squares: less than these beyond it is not known to be
there."""

CLEAR = 9.0
SMOOTH = 2.25
"""The square of the three standard deviations by which a trend has to explain more than noise that
happens to be along it, and how much more of that there is where patches overlap than in one."""


def noise_of_pixels(measured: NDArray[np.float32]) -> float:
    """Return the standard deviation of the images' noise.

    By the median of high differences along the pixels' order: what flames show is smooth, and
    where it is not, at edges and from one row to the next, few. Noise that is not the same
    everywhere is rather found too low. 0 where there are too few pixels to tell.
    """
    if len(measured) <= ORDER:
        return 0.0
    apart = np.abs(np.diff(measured.astype(np.float64), ORDER))
    return float(np.median(apart)) / (NORMAL_MEDIAN * math.sqrt(math.comb(2 * ORDER, ORDER)))


def beyond_noise(squared: float, noise: float, patches: int) -> float:
    """Return the root of what is known of a squared misfit of patches beyond the noise's.

    At least as much as the noise alone may make more or less of it by chance: what is smaller
    does not show, and to explain shares of it says nothing.

    Parameters
    ----------
    squared, noise : float
        Squares summed over the patches: of all that is left, and what noise makes of it.
    patches : int
    """
    unsure = SURE * noise * math.sqrt(2 * OVERLAP / max(patches, 1))
    return math.sqrt(max(squared - noise, unsure))


def chance_of_a_trend(noise: float, patches: int) -> float:
    """Return how much of the noise's squares, summed over patches, a trend may well explain."""
    return CLEAR * SMOOTH * noise / max(patches, 1)
