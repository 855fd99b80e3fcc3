"""Images that were cut off at some level, at full scale or below."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.measurement.noise_model import NoiseModel

FEWEST = 8
"""Pixels at the largest value. Fewer are chance, most of all in images of few grey levels."""

SIGMAS = 2.0
"""Standard deviations below the largest value within which fewer pixels lie than at it."""

STEPS = 2.0
"""The same in steps between grey levels, where these are coarser than the noise: a smooth peak has
as many pixels in two steps below its top as in the top step."""


def cut_off_level(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float | None:
    """Return the level that an image was cut off at, None where it was not.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool
        True where a pixel is usable.
    noise : NoiseModel

    Notes
    -----
    Light beyond a camera's largest value is recorded as that value, so that more pixels have it
    than lie just below it. The top of a flame has one pixel of the largest value and many below,
    spread by the noise.
    """
    values = np.asarray(image, np.float64)[np.asarray(mask, bool)]
    if not len(values):
        return None
    top = float(values.max())
    count = int(np.count_nonzero(values == top))
    if count < FEWEST or not top > 0:
        return None
    step = top - float(values.max(where=values < top, initial=0.0))
    below = top - max(SIGMAS * float(np.sqrt(noise.variance(top))), STEPS * step)
    near = int(np.count_nonzero((values >= below) & (values < top)))
    return top if count > near and below > 0 else None
