"""What single images show by themselves: bad pixels, saturation, dark levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import CameraLike, Rig
from tomo.measurement.noise_model import SIDE, NoiseModel, block_means, estimate_noise
from tomo.measurement.outlier_pixels import find_outlier_pixels

LEVEL_SIGMAS = 5.0  # standard deviations of a block's mean that the background must exceed
FRACTION = 0.01  # fraction of the brightest block, added to that limit

FLOOR = (0.02, 0.2)
"""Quantiles of the blocks' means between which a uniform background is flat; emission fades."""

FLAT = 0.05
"""Fraction of the background by which the two quantiles may differ, besides their noise."""

BELOW_SIGMAS = 4.0  # standard deviations of a block's mean below zero that count
BELOW_FRACTION = 0.005  # fraction of the brightest block, added to that limit
BELOW_AREA = 0.02
"""Fraction of the blocks that must lie below zero; fewer can be chance."""


def background(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the level of an image's uniform background, in image units; 0 for none.

    Blocks of 4 x 4 usable pixels (``mask``) are averaged. There is a background where the 2 %
    quantile of the means exceeds five standard deviations of a mean plus 1 % of the brightest
    block, and the 2 % and 20 % quantiles differ by at most three standard deviations plus 5 %.
    """
    means = block_means(image, mask)
    if not means.size:
        return 0.0
    lowest, level = np.quantile(means, FLOOR).tolist()
    sigma = float(np.sqrt(noise.variance(max(level, 0.0)))) / SIDE
    if lowest <= LEVEL_SIGMAS * sigma + FRACTION * means.max():
        return 0.0
    return level if level - lowest <= 3 * sigma + FLAT * level else 0.0


def below_zero(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float:
    """Return the median depth of the blocks below zero, in image units; 0 for none.

    Emission is never negative, so a dark region is zero within the noise. A block of 4 x 4 usable
    pixels lies below zero when its mean is below minus four of its standard deviations minus 0.5 %
    of the brightest block. Noise explains up to 2 % of such blocks; beyond that the median of
    their means is returned, as a positive number.
    """
    means = block_means(image, mask)
    if not means.size:
        return 0.0
    far = BELOW_SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + BELOW_FRACTION * max(
        means.max(), 0.0
    )
    below = means[means < -far]
    return float(-np.median(below)) if len(below) > BELOW_AREA * means.size else 0.0


FEWEST = 8
"""Pixels at the largest value. Fewer are chance, most of all in images of few grey levels."""

SIGMAS = 2.0
"""Standard deviations below the largest value within which fewer pixels lie than at it; steps
between grey levels where these are coarser than the noise: a smooth peak has as many pixels in two
steps below its top as in the top step."""


def cut_off_level(image: ArrayLike, mask: ArrayLike, noise: NoiseModel) -> float | None:
    """Return the level that an image was cut off at, None where it was not.

    Light beyond a camera's largest value is recorded as that value, so that more usable pixels
    (``mask``) have it than lie just below it. The top of a flame has one pixel of the largest
    value and many below, spread by the noise.
    """
    values = np.asarray(image, np.float64)[np.asarray(mask, bool)]
    if not len(values):
        return None
    top = float(values.max())
    count = int(np.count_nonzero(values == top))
    if count < FEWEST or not top > 0:
        return None
    step = top - float(values.max(where=values < top, initial=0.0))
    below = top - SIGMAS * max(float(np.sqrt(noise.variance(top))), step)
    near = int(np.count_nonzero((values >= below) & (values < top)))
    return top if count > near and below > 0 else None


def check_sizes(what: str, images: Sequence[NDArray], cameras: Rig | Sequence[CameraLike]) -> None:
    """Refuse images that are not one a camera, each of its camera's size."""
    if len(images) != len(cameras):
        raise ValueError(
            f"{what}: found {len(images)}, expected one for each of {len(cameras)} cameras"
        )
    for camera, image in zip(cameras, images, strict=True):
        width, height = camera.image_size
        if np.shape(image) != (height, width):
            raise ValueError(
                f"{what}: camera {camera.name}: found shape {np.shape(image)}, expected "
                f"{(height, width)}"
            )


@dataclass(frozen=True, eq=False)
class PixelCheck:
    """The pixels of some images that can be used, and what is wrong with the others.

    ``masks`` (height, width) are True where a pixel is usable and no outlier. By camera: how many
    ``outliers`` there are, and pixels that were ``usable``; where there is such a thing, how far
    dark regions lie ``below_zero``, the level of a uniform ``background``, and the one at which
    the image was cut off, ``saturated``, in image units.
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
    """Find outlier pixels, saturation, and dark levels that are not zero, each image by itself."""
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
