"""Inverse-variance weights of pixels for least squares."""

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
"""Standard deviation of the discretisation error, as a fraction of the detail finer than voxels
that images show. Lower: dark pixels, which have little photon noise, weigh too much."""

VOXEL_BLUR = 0.5
"""Standard deviation, in voxels, of the blur that removes the detail finer than voxels."""

LEAST_MISSED = 0.005
"""Least discretisation error, as a fraction of the brightest light."""

EQUAL = 2.0
"""Ratio of the largest to the least variance below which all pixels weigh alike: errors of the
noise estimate reach 1.7."""

BLUR = 1.0
"""Standard deviation, in pixels, of the blur before the signal is read: unblurred, a pixel that
is dark by its own noise would weigh more."""


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """The weights of the pixels of some images."""

    images: tuple[NDArray[np.float32], ...] | None
    """Inverse variances over the largest of all; None where all pixels weigh alike."""
    variance_ratio: float  # of the largest variance to the smallest, or an upper bound of it

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        if self.images is None:
            return {"used": False, "reason": "all pixels are about equally noisy"}
        reason = f"the noisiest pixels have {self.variance_ratio:.3g} times the variance of others"
        return {"used": True, "reason": reason}


def weigh_pixels(
    images: Sequence[NDArray[np.floating]],
    masks: Sequence[NDArray[np.bool_]],
    noise: Sequence[NoiseModel],
    pixels_a_voxel: Sequence[float],
) -> PixelWeights:
    """Return inverse-variance weights from the noise and the discretisation error.

    The variance is ``read² + gain x signal + missed²``; the best linear unbiased estimate weighs
    by its inverse (Aitken, "On least squares and linear combination of observations", Proceedings
    of the Royal Society of Edinburgh 55, 1936). The discretisation error ``missed`` is `FINER`
    times the root mean square, weighted by the signal, of the images' detail that is finer than
    voxels and exceeds the noise.

    ``pixels_a_voxel`` are the pixels along a voxel's edge in each view; one of NaN, where that is
    unknown, says nothing of the discretisation error. ``masks`` are True where pixels are usable.
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
    variance_ratio = most / (min(model.read for model in models) ** 2 + LEAST_MISSED**2)
    if variance_ratio < EQUAL:  # an upper bound, whatever the images show
        return PixelWeights(None, variance_ratio)
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
    """Return the squared detail that a blur removes, less its noise, weighted by the signal."""
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
    """Return the weights for ``signals``, fractions of the brightest light."""
    variances, least, largest = [], np.inf, 0.0
    for signal, mask, model in zip(signals, masks, noise, strict=True):
        variance = (model.variance(signal) / missed**2 + 1).astype(np.float32)
        variances.append(variance)
        least = min(least, variance[mask].min(initial=np.inf))
        largest = max(largest, variance[mask].max(initial=0.0))
    variance_ratio = float(largest / least)
    if variance_ratio < EQUAL:
        return PixelWeights(None, variance_ratio)
    for variance in variances:  # in place: images may be many and large
        np.minimum(np.divide(least, variance, out=variance), 1, out=variance)
    return PixelWeights(tuple(variances), variance_ratio)


def _blurred(
    image: NDArray[np.floating], mask: NDArray[np.bool_], width: float
) -> NDArray[np.floating]:
    """Return the Gaussian mean of the usable pixels around each, zero where there are none.

    ``width`` is a standard deviation in pixels; unusable pixels of the image are zero.
    """
    total = ndimage.gaussian_filter(image, width)
    if mask.all():
        return total
    count = ndimage.gaussian_filter(mask.astype(total.dtype), width)
    return np.divide(total, count, out=np.zeros_like(total), where=count > 1e-6)
