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
PEDESTAL = 100 / (2**BITS - 1)
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
    random, brightest = np.random.default_rng(seed), float(image.max())
    if noise == TWELVE_BIT:
        photons = PHOTONS * brightest / BRIGHTEST
        counted = camera_noise.poisson(image, photons, READ_NOISE, random)
        return camera_noise.quantise(np.minimum(counted, most) + PEDESTAL, BITS, 1.0)
    if noise == GAUSSIAN:
        image = camera_noise.gaussian(image, FRACTION * BRIGHTEST / brightest, random)
    return np.minimum(image, most).astype(np.float32)


def corrections(noise: str) -> Corrections | None:
    """Return what a scan knows of such cameras."""
    return Corrections(dark=PEDESTAL, bit_depth=BITS) if noise == TWELVE_BIT else None
