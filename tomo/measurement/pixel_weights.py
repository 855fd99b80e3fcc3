"""What pixels are worth to least squares: one over the variance of what they may be off by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from tomo.measurement.noise_model import NoiseModel

FINER = 0.5
"""A standard deviation of what voxels and single rays miss of a pixel, over what images show that
is finer than voxels. Without it dark pixels, which photons leave almost no noise, would count for
more than voxels can tell. By 0.3 to 0.5 flames came equally near to the truth on the whole; those
that voxels do not resolve lost least by 0.5."""

VOXEL_BLUR = 0.5
"""Voxels, a standard deviation: what an image so blurred has lost is finer than voxels."""

LEAST_MISSED = 0.005
"""Of the brightest light: voxels miss that much, however smooth images are."""

EVEN = 2.0
"""Where no pixel's variance is so many times another's all count alike: chance in the estimated
noise of 33 views alone has made 1.7."""

BLUR = 1.0
"""Pixels, a standard deviation, that the signal is looked at over: by its own noise a pixel that
happens to be dark would count for more."""


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """What the pixels of some images are worth.

    Attributes
    ----------
    images : tuple of (height, width) float32, optional
        Inverse variances, the largest of all is 1; None where all count alike.
    spread : float
        The largest variance over the smallest, or more.
    """

    images: tuple[NDArray[np.float32], ...] | None
    spread: float

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        if self.images is None:
            return {"used": False, "reason": "pixels are about as noisy as each other"}
        reason = f"the noisiest pixels have {self.spread:.3g} times the variance of others"
        return {"used": True, "reason": reason}


def weigh_pixels(
    images: Sequence[NDArray[np.floating]],
    masks: Sequence[NDArray[np.bool_]],
    noise: Sequence[NoiseModel],
    pixels_a_voxel: Sequence[float],
) -> PixelWeights:
    """Weigh pixels by their noise, and by what voxels miss of any of them.

    Parameters
    ----------
    images : sequence of (height, width)
        One a view.
    masks : sequence of (height, width) bool
        True where a pixel is usable; others say nothing of their neighbours' signal.
    noise : sequence of NoiseModel
        One a view.
    pixels_a_voxel : sequence of float
        How many pixels a voxel is across, in each view; NaN where that is not known, and the view
        not asked what voxels miss.

    Notes
    -----
    The variance is ``read² + gain x signal + missed²``: the best linear unbiased estimate weighs
    by its inverse (Aitken, "On least squares and linear combination of observations", Proceedings
    of the Royal Society of Edinburgh 55, 1936). What voxels miss is `FINER` times what images show
    that is finer than voxels and no noise: its root mean square, weighted by the signal.
    """
    tops = [
        float(np.max(image, where=mask, initial=0.0))
        for image, mask in zip(images, masks, strict=True)
    ]
    brightest = max(tops, default=0.0)
    if brightest == 0:
        return PixelWeights(None, 1.0)
    models = [NoiseModel(one.read / brightest, one.gain / brightest) for one in noise]
    most = max(float(model.variance(1.0)) for model in models) + LEAST_MISSED**2
    spread = most / (min(model.read for model in models) ** 2 + LEAST_MISSED**2)
    if spread < EVEN:  # it is no more, whatever the images show
        return PixelWeights(None, spread)
    signals, light, finer = [], 0.0, 0.0
    for image, mask, model, across in zip(images, masks, models, pixels_a_voxel, strict=True):
        image = np.where(mask, image, 0) / brightest
        signal = np.maximum(_blurred(image, mask, BLUR), 0)
        signals.append(signal.astype(np.float32))
        if np.isfinite(across):
            light += float(np.sum(signal, where=mask, dtype=np.float64))
            finer += _finer(image, mask, signal, model, VOXEL_BLUR * across)
    missed = FINER * math.sqrt(max(finer, 0.0) / light) if light > 0 else 0.0
    return _weights(signals, masks, models, max(missed, LEAST_MISSED))


def _finer(
    image: NDArray[np.floating],
    mask: NDArray[np.bool_],
    signal: NDArray[np.floating],
    model: NoiseModel,
    blur: float,
) -> float:
    """Return the squares of what a blur takes away, less its noise, weighted by the signal."""
    lost = image - _blurred(image, mask, blur)
    size = 2 * math.ceil(4 * blur) + 3
    response = ndimage.gaussian_filter1d(np.eye(1, size, size // 2)[0], blur)
    kept = 1 - 2 * response.max() ** 2 + np.sum(response**2) ** 2  # of white noise's variance
    squares = lost**2 - kept * model.variance(signal)
    return float(np.sum(signal * squares, where=mask, dtype=np.float64))


def _weights(
    signals: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    noise: Sequence[NoiseModel],
    missed: float,
) -> PixelWeights:
    """Return the weights of pixels of such signals, all relative to the brightest light."""
    variances, least, largest = [], np.inf, 0.0
    for signal, mask, model in zip(signals, masks, noise, strict=True):
        variance = (model.variance(signal) / missed**2 + 1).astype(np.float32)
        variances.append(variance)
        least = min(least, variance[mask].min(initial=np.inf))
        largest = max(largest, variance[mask].max(initial=0.0))
    spread = float(largest / least)
    if spread < EVEN:
        return PixelWeights(None, spread)
    for variance in variances:  # in place: images may be many and large
        np.minimum(np.divide(least, variance, out=variance), 1, out=variance)
    return PixelWeights(tuple(variances), spread)


def _blurred(
    image: NDArray[np.floating], mask: NDArray[np.bool_], width: float
) -> NDArray[np.floating]:
    """Return the mean of what usable pixels around each show, zero where there are none.

    ``width`` is a standard deviation in pixels; unusable pixels of the image are zero.
    """
    total = ndimage.gaussian_filter(image, width)
    if mask.all():
        return total
    count = ndimage.gaussian_filter(mask.astype(total.dtype), width)
    return np.divide(total, count, out=np.zeros_like(total), where=count > 1e-6)
