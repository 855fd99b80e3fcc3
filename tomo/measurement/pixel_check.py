"""What single images show by themselves: bad pixels, saturation, dark levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.measurement.background import background, below_zero
from tomo.measurement.noise_model import NoiseModel, estimate_noise
from tomo.measurement.outlier_pixels import find_outlier_pixels

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


@dataclass(frozen=True, eq=False)
class PixelCheck:
    """The pixels of some images that can be used, and what is wrong with the others.

    Attributes
    ----------
    masks : tuple of (height, width) bool
        One a camera: True where a pixel is usable and no outlier.
    noise : tuple of NoiseModel
        One a camera.
    outliers, usable : mapping of str to int
        Camera to its number of outlier pixels, and of pixels that were usable.
    below_zero : mapping of str to float
        Camera to how far its dark regions lie below zero, in image units; only those that do.
    background : mapping of str to float
        Camera to the level of its image's uniform background; only cameras that have one.
    saturated : mapping of str to float
        Camera to the level that its image was cut off at; only those that were.
    """

    masks: tuple[NDArray[np.bool_], ...]
    noise: tuple[NoiseModel, ...]
    outliers: Mapping[str, int]
    usable: Mapping[str, int]
    below_zero: Mapping[str, float] = field(default_factory=dict)
    background: Mapping[str, float] = field(default_factory=dict)
    saturated: Mapping[str, float] = field(default_factory=dict)

    def report(self) -> dict[str, Any]:
        """Return plain numbers for report.json: counts, and levels in image units, by camera."""
        return {
            "outlier_pixels": dict(self.outliers),
            "below_zero": dict(self.below_zero),
            "background": dict(self.background),
            "saturated": dict(self.saturated),
        }


def check_pixels(
    names: Sequence[str],
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
) -> PixelCheck:
    """Find outlier pixels, saturation, and dark levels that are not zero, each image by itself.

    Parameters
    ----------
    names : sequence of str
        The cameras'.
    images : sequence of (height, width) float32
    masks : sequence of (height, width) bool
        True where a pixel is usable.
    """
    noise = tuple(estimate_noise(i, m) for i, m in zip(images, masks, strict=True))
    outliers = [find_outlier_pixels(i, m, n) for i, m, n in zip(images, masks, noise, strict=True)]
    clean = [m & ~o for m, o in zip(masks, outliers, strict=True)]
    tops = [cut_off_level(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    clean = [
        mask if top is None else mask & (image < top)
        for image, mask, top in zip(images, clean, tops, strict=True)
    ]
    depths = [below_zero(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    levels = [background(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    return PixelCheck(
        tuple(clean),
        noise,
        {name: int(np.count_nonzero(o)) for name, o in zip(names, outliers, strict=True)},
        {name: int(np.count_nonzero(m)) for name, m in zip(names, masks, strict=True)},
        {name: depth for name, depth in zip(names, depths, strict=True) if depth > 0},
        {name: level for name, level in zip(names, levels, strict=True) if level > 0},
        {name: top for name, top in zip(names, tops, strict=True) if top is not None},
    )
