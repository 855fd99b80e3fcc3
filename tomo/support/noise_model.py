"""How noisy a camera is, judged from one of its images: read-out and photon noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._threads import share_range
from tomo.support._noise_kernels import read_and_gain


@dataclass(frozen=True)
class NoiseModel:
    """The noise of a camera: ``variance = read^2 + gain * signal``.

    Attributes
    ----------
    read : float
        Standard deviation in the dark, in the image's units.
    gain : float
        Image units a detected photon: what the variance grows by with the signal.

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
        """Return the variance of every pixel; zero where the model knows of no noise.

        What is below zero counts as dark.
        """
        return self.read**2 + self.gain * np.maximum(np.asarray(image, np.float64), 0)

    def weights(self, image: ArrayLike) -> NDArray[np.float32]:
        """Return ``1 / variance`` for least squares, scaled to at most 1; ones without noise.

        A variance counts as no less than a thousandth of that of the brightest pixel: no pixel is
        worth a thousand others.
        """
        variance = self.variance(image)
        floor = max(1e-3 * variance.max(initial=0.0), np.finfo(np.float64).tiny)
        variance = np.maximum(variance, floor)
        return (variance.min(initial=np.inf) / variance).astype(np.float32)


def estimate_noise(
    image: ArrayLike, mask: ArrayLike | None = None, expected: ArrayLike | None = None
) -> NoiseModel:
    """Estimate the noise of a camera from an image, and from what is known of it.

    Parameters
    ----------
    image : (height, width)
    mask : (height, width) bool, optional
        True where a pixel is usable.
    expected : (height, width), optional
        The image without its noise as far as it is known, a volume re-projected say: its fine
        structure is not taken for noise, and it tells the signal.

    Raises
    ------
    ValueError
        If the mask or what is expected has another shape than the image.

    Notes
    -----
    The 3 x 3 filter ``[1 -2 1]^T [1 -2 1] / 6`` keeps the variance of white noise and takes away
    whatever is linear along rows or along columns; its output does not correlate with the mean of
    the same nine pixels. By that mean the pixels are put into levels of equal count, and in each
    the lower quartile of the filter's magnitude gives a spread that edges and fine structure,
    which only enlarge it, hardly move. A line of non-negative intercept and slope through
    (mean, spread^2), weighted by the line itself, gives ``read`` and ``gain``.

    Where two or more of the nine pixels are exactly zero the noise was clipped or background was
    cut out: those say nothing. The filter is that of Immerkaer, "Fast noise variance estimation",
    Computer Vision and Image Understanding 64 (1996).
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
    return NoiseModel(*read_and_gain(image, usable, signal, expected is not None))


def noise_of_all(
    images: Sequence[ArrayLike], masks: Sequence[ArrayLike | None]
) -> tuple[NoiseModel, ...]:
    """Return the noise of each image, some of them at a time; see `estimate_noise`."""
    found: list[NoiseModel] = [NoiseModel(0.0)] * len(images)

    def estimate(start: int, stop: int) -> None:
        for view in range(start, stop):
            found[view] = estimate_noise(images[view], masks[view])

    share_range(len(images), estimate)
    return tuple(found)
