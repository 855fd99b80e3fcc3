"""Cameras: the noise of an image, and the numbers that it is recorded as."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo import Corrections
from tomo.simulation import camera_noise

CLEAN, TWELVE_BIT, GAUSSIAN = NOISES = ("clean", "12 bit", "10 %")
BRIGHTEST = 0.85
"""The brightest pixel of faultless images without noise, over full scale."""

PHOTONS, READ_NOISE = 5000.0, 8.0
"""Electrons in the brightest pixel, and of the read-out: 1.4 % and 0.16 % of the maximum."""

BITS = 12
FULL = 2**BITS - 1
PEDESTAL = 100 / FULL
"""What 12-bit cameras add to every pixel, and scans know as dark: noise is not cut off at 0."""

FRACTION = 0.10


def recorded(
    image: NDArray[np.float64], noise: str, seed: tuple[int, int], most: float = np.inf
) -> NDArray:
    """Return what a camera records of an image in units of full scale.

    Parameters
    ----------
    image : (height, width)
    noise : str
        One of `NOISES`: none; photons and read-out in 12 bits, uint16; or white noise of a tenth
        of `BRIGHTEST` in every pixel.
    seed : (int, int)
        Of the scene, and the number of the camera: what is wrong with one image leaves the noise
        of the others as it is.
    most : float
        The most that the camera can record.
    """
    random = np.random.default_rng(seed)
    if noise == TWELVE_BIT:
        counted = camera_noise.poisson(image, PHOTONS, READ_NOISE, random, maximum=BRIGHTEST)
        return camera_noise.quantise(np.minimum(counted, most) + PEDESTAL, BITS, 1.0)
    if noise == GAUSSIAN:
        image = camera_noise.gaussian(image, FRACTION, random, maximum=BRIGHTEST)
    return np.minimum(image, most).astype(np.float32)


def stored(image: NDArray, noise: str, gamma: float, dead: str) -> NDArray:
    """Return what is kept of a recorded image: 8 bits along a gamma curve, or one value of all.

    The range of numbers stays, and the pedestal, which is taken away before the curve.
    """
    pedestal, full = (PEDESTAL * FULL, FULL) if noise == TWELVE_BIT else (0.0, 1.0)
    if dead:
        return np.full_like(image, 0 if dead == "zeros" else round(pedestal))
    if gamma != 1:
        light = np.clip((image.astype(np.float64) - pedestal) / full, 0, 1) ** (1 / gamma)
        kept = np.rint(255 * light) / 255 * full + pedestal
        image = (np.rint(kept).clip(max=full) if noise == TWELVE_BIT else kept).astype(image.dtype)
    return image


def corrections(noise: str) -> Corrections | None:
    """Return what a scan knows of such cameras."""
    return Corrections(dark=PEDESTAL, bit_depth=BITS) if noise == TWELVE_BIT else None
