"""The noise of pixels from their differences along the image's rows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ORDER = 5
"""Order of the differences. Lower: sharp edges of clean images count as noise. Higher: fewer
differences escape edges and row ends."""

NORMAL_MEDIAN = 0.6745
"""Median absolute value of a standard normal deviate."""


def noise_from_differences(pixels: NDArray[np.floating]) -> float:
    """Return the standard deviation of the noise of ``pixels`` (n,), in their order in the image.

    The estimate is the median of high differences: flames are smooth, and edges and row ends are
    few. Where the noise varies over the image the estimate is rather too low. It is 0 where there
    are too few pixels.

    Notes
    -----
    ``sigma = median |Δ⁵ b| / (0.6745 sqrt(C(10, 5)))``.
    """
    if len(pixels) <= ORDER:
        return 0.0
    apart = np.abs(np.diff(pixels.astype(np.float64), ORDER))
    return float(np.median(apart)) / (NORMAL_MEDIAN * math.sqrt(math.comb(2 * ORDER, ORDER)))
