"""Effects of cameras on images: noise, a finite number of grey levels, saturation.

Every function takes one array of any shape or a list of arrays (images of cameras of different
sizes) and gives back the same. A "maximum" is the maximum over all of them: cameras of one rig
share exposure and gain. Random functions draw from the numpy Generator given and from nothing
else: the same state gives bit-identical results, and an array gives the same values as the list
of its images.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Images = TypeVar("Images", NDArray, Sequence[NDArray])


def gaussian(
    images: Images,
    fraction: float,
    rng: np.random.Generator,
    *,
    maximum: float | None = None,
) -> Images:
    """Return the images plus white noise whose sigma is ``fraction`` of their, or the, maximum."""
    parts, finish = _open(images)
    sigma = fraction * (_maximum(parts) if maximum is None else maximum)
    noisy = [part + sigma * rng.standard_normal(part.shape) for part in parts]
    return finish(noisy)


def poisson(
    images: Images,
    photons_at_maximum: float,
    read_noise_electrons: float,
    rng: np.random.Generator,
    *,
    maximum: float | None = None,
) -> Images:
    """Return the images, finite and >= 0, with the noise of counted photons and of the read-out.

    A value ``v`` becomes ``(Poisson(g v) + read_noise N(0, 1)) / g``, where the gain ``g`` maps
    the images' maximum (see `gaussian`) to ``photons_at_maximum`` detected photons: the scale is
    kept, the variance is ``v / g + (read_noise / g)²``. Read noise, in electrons, may make dark
    pixels negative.
    """
    parts, finish = _open(images)
    lowest = min(float(part.min()) for part in parts)
    if lowest < 0:
        raise ValueError(f"images: found a negative value, {lowest:g}, expected photons, >= 0")
    maximum = _maximum(parts) if maximum is None else maximum
    if maximum == 0:
        raise ValueError("images: found only zeros, expected a maximum to scale photons by")
    gain = photons_at_maximum / maximum
    counts = [rng.poisson(gain * part) for part in parts]
    return finish(
        [(n + read_noise_electrons * rng.standard_normal(n.shape)) / gain for n in counts]
    )


def noisy(
    images: Images,
    rng: np.random.Generator,
    fraction: float = 0.0,
    photons: float | None = None,
    read_noise: float = 0.0,
    *,
    maximum: float | None = None,
) -> Images:
    """Return the images with photon and read noise, where ``photons`` are given, then white noise.

    Arguments as of `poisson` and `gaussian`.
    """
    if photons is not None:
        images = poisson(images, photons, read_noise, rng, maximum=maximum)
    return gaussian(images, fraction, rng, maximum=maximum) if fraction else images


def quantise(images: Images, bits: int, full_scale: float) -> Images:
    """Return the images as the integers of a camera, ``round(v / full_scale · (2^bits - 1))``.

    uint8 up to 8 of at most 16 bits, uint16 above (12 bits fill 0 to 4095). Values below zero
    become 0 and those above ``full_scale`` the highest integer. In between the error is at most
    half a step, see :func:`dequantise`.
    """
    step = _step(bits, full_scale)
    parts, finish = _open(images, np.dtype(np.uint8 if bits <= 8 else np.uint16))
    return finish([np.clip(np.rint(part / step), 0, 2**bits - 1) for part in parts])


def dequantise(images: Images, bits: int, full_scale: float) -> Images:
    """Return the intensities, float32, that the integers of :func:`quantise` stand for."""
    step = _step(bits, full_scale)
    parts, finish = _open(images, np.dtype(np.float32))
    return finish([part * step for part in parts])


def _open(images: NDArray | Sequence[NDArray], dtype: np.dtype | None = None):
    """Return the images as float64 arrays, and a function that gives results the input's form.

    Results have ``dtype``, or when None the floating type that came in, float32 for integers.
    """
    single = isinstance(images, np.ndarray)
    originals = (
        [images] if isinstance(images, np.ndarray) else [np.asarray(image) for image in images]
    )
    if not originals or any(image.size == 0 for image in originals):
        raise ValueError("images: found none or an empty one, expected at least one pixel each")
    for number, image in enumerate(originals):
        if not np.isfinite(image).all():
            raise ValueError(f"images: found NaN or infinity in image {number}, expected finite")

    def finish(results: list[NDArray]) -> NDArray | list[NDArray]:
        kinds = [
            dtype or (image.dtype if image.dtype.kind == "f" else np.dtype(np.float32))
            for image in originals
        ]
        with np.errstate(over="ignore"):  # an overflow is reported as infinity below
            typed = [result.astype(kind) for result, kind in zip(results, kinds, strict=True)]
        for kind, image in zip(kinds, typed, strict=True):
            if not np.isfinite(image).all():
                raise ValueError(
                    f"noise: found noisy intensities that overflow {kind}, expected less noise"
                )
        return typed[0] if single else typed

    return [image.astype(np.float64) for image in originals], finish


def _maximum(parts: list[NDArray[np.float64]]) -> float:
    return max(float(part.max()) for part in parts)


def _step(bits: int, full_scale: float) -> float:
    """Return the intensity between two neighbouring integers."""
    if bits != int(bits) or not 1 <= bits <= 16:
        raise ValueError(f"bits: found {bits}, expected a whole number from 1 to 16")
    if not (np.isfinite(full_scale) and full_scale > 0):
        raise ValueError(f"full_scale: found {full_scale}, expected a finite number > 0")
    return full_scale / (2 ** int(bits) - 1)
