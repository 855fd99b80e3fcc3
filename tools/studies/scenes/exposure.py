"""How an image comes about: where its camera stands, what its lens does, noise, and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter1d

from rigs import Camera
from studies.scenes.fields import Field
from studies.scenes.forward import NO_GAS, radiance
from studies.scenes.media import Gas
from tomo import Corrections
from tomo.simulation import camera_noise

LIT = 0.02  # fraction of an image's maximum above which a pixel counts as showing the flame
GHOST_SHIFT = 0.15
"""By how much of the image's width a reflection in a lens lies beside its mirror image."""

VEIL_WIDTH = 0.2  # standard deviation of scattered light around its source, over the image's width
CLEAN, TWELVE_BIT, GAUSSIAN = NOISES = ("clean", "12 bit", "10 %")
BRIGHTEST = 0.85  # the brightest pixel of faultless images without noise, over full scale
PHOTONS, READ_NOISE = 5000.0, 8.0
"""Electrons in the brightest pixel, and of the read-out: 1.4 % and 0.16 % of the maximum."""

BITS = 12
FULL = 2**BITS - 1
PEDESTAL = 100 / FULL
"""What 12-bit cameras add to every pixel, and scans know as dark: noise is not cut off at 0."""

FRACTION = 0.10


@dataclass(frozen=True)
class Exposure:
    """What happens to the light on its way into one image."""

    camera: Camera  # as it really stands, which may differ from what the rig says
    field: Field
    gas: Gas = NO_GAS
    blur: float = 0.0  # standard deviation of a Gaussian blur, in pixels
    motion: int = 1  # columns over which the image is smeared
    ghost: float = 0.0  # fraction of the light that is seen once more, mirrored and beside itself
    veil: float = 0.0  # fraction of the light that is seen once more, scattered widely
    # fraction of light lost in the corners; the loss grows with the square of the distance
    vignetting: float = 0.0
    # fraction of the flame's width in the image behind an opaque frame, from the left
    hidden: float = 0.0
    # fraction of the flame's width and height behind an opaque frame, half of it on each side
    framed: float = 0.0
    gain: float = 1.0
    background: float = 0.0  # added to every pixel, as a fraction of full scale
    # background at the image's right edge, as a fraction of full scale; none at its left
    gradient: float = 0.0
    # a column, and what is added to it, as a fraction of full scale
    hot: tuple[int, float] = (0, 0.0)
    # fraction of the image's maximum that is the most it can record; not applied here, since noise
    # comes first
    saturation: float = 1.0
    # ``""``, ``"across"``, ``"down"`` or ``"both"``: how the stored image is turned over
    mirrored: str = ""
    # that of the curve along which it is stored in 8 bits; 1: it is stored as it is
    gamma: float = 1.0
    dead: str = ""  # ``"zeros"`` or ``"pedestal"``: the one value that is stored of all pixels
    taken_by: int | None = None  # the number of the camera whose file this is: its noise too

    @property
    def sight(self) -> tuple[Any, ...]:
        """All that `light` depends on."""
        return self.camera, self.field, self.gas

    def light(self) -> NDArray[np.float64]:
        """Return what arrives at the lens, ``(height, width)``, in the field's unit."""
        return radiance(*self.sight)

    def image(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the image without noise of ``light`` in units of full scale."""
        if self.hidden or self.framed:
            light = np.where(self._behind_frame(light), 0, light)
        light = light + self._reflected(light)
        if self.blur:
            light = gaussian_filter(light, self.blur, mode="nearest")
        if self.motion > 1:
            light = uniform_filter1d(light, self.motion, axis=1, mode="nearest")
            light = np.maximum(light, 0)  # running sums end a rounding below
        if self.vignetting:
            light = light * self._falloff(light.shape)
        if self.mirrored in ("across", "both"):
            light = light[:, ::-1]
        if self.mirrored in ("down", "both"):
            light = light[::-1]
        image = self.gain * light + self.background
        image = image + self.gradient * np.linspace(0, 1, light.shape[1])
        column, level = self.hot
        image[:, column] += level
        return image

    def _behind_frame(self, light: NDArray[np.float64]) -> NDArray[np.bool_]:
        lit, hidden = light > LIT * light.max(), np.zeros(light.shape, bool)
        for axis, own in enumerate(np.indices(light.shape)):
            there = np.flatnonzero(lit.any(axis=1 - axis))
            first, end = there[0], there[-1] + 1
            room = self.framed / 2 * (end - first)
            if self.framed:
                hidden |= (own < first + room) | (own >= end - room)
            if axis:
                hidden |= own < first + self.hidden * (end - first)
        return hidden

    def _reflected(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what lenses send elsewhere, once more."""
        width, found = light.shape[1], np.zeros_like(light)
        if self.ghost:
            beside = round(GHOST_SHIFT * width)
            found[:, beside:] += self.ghost * light[:, ::-1][:, : width - beside]
        if self.veil:
            found += self.veil * gaussian_filter(light, VEIL_WIDTH * width, mode="constant")
        return found

    def _falloff(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        middle = (np.array(shape) - 1) / 2
        rows, columns = np.indices(shape)
        square = (rows - middle[0]) ** 2 + (columns - middle[1]) ** 2
        return 1 - self.vignetting * square / np.square(middle).sum()


def recorded(
    image: NDArray[np.float64], noise: str, seed: tuple[int, int], most: float = np.inf
) -> NDArray:
    """Return what a camera records of an image in units of full scale, at most ``most``.

    `NOISES` are none; photons and read-out in 12 bits, uint16; and white noise of a tenth of
    `BRIGHTEST` in every pixel. The seed is the scene's, with the number of the camera: what is
    wrong with one image leaves the noise of the others as it is.
    """
    random = np.random.default_rng(seed)
    if noise == TWELVE_BIT:
        counted = camera_noise.poisson(image, PHOTONS, READ_NOISE, random, maximum=BRIGHTEST)
        return camera_noise.quantise(np.minimum(counted, most) + PEDESTAL, BITS, 1.0)
    if noise == GAUSSIAN:
        image = camera_noise.gaussian(image, FRACTION, random, maximum=BRIGHTEST)
    return np.minimum(image, most).astype(np.float32)


def stored(image: NDArray, noise: str, gamma: float, dead: str) -> NDArray:
    """Return what is kept of a recorded image: 8 bits along a gamma curve, or one value of all."""
    # the range of numbers stays, and the pedestal, which is taken away before the curve
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
