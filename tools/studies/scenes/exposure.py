"""How one image comes about: where its camera really stands, what it sees, what its lens does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter1d

from rigs import Camera
from studies.scenes.fields import Field
from studies.scenes.forward import radiance
from studies.scenes.media import Absorber, Bending

LIT = 0.02
"""Fraction of an image's maximum above which a pixel counts as showing the flame."""

GHOST_SHIFT = 0.15
"""By how much of the image's width a reflection in a lens lies beside its mirror image."""

VEIL_WIDTH = 0.2
"""Standard deviation of scattered light around its source, over the image's width."""


@dataclass(frozen=True)
class Exposure:
    """What happens to the light on its way into one image."""

    camera: Camera  # as it really stands, which may differ from what the rig says
    field: Field
    # self_absorption, absorption: see `studies.scenes.forward.radiance`
    self_absorption: float = 0.0
    absorption: float = 0.0
    absorber: Absorber | None = None
    bending: Bending | None = None  # the same
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
        gas = self.self_absorption, self.absorption, self.absorber, self.bending
        return self.camera, self.field, *gas

    def light(self) -> NDArray[np.float64]:
        """Return what arrives at the lens, ``(height, width)``, in the field's unit."""
        return radiance(
            self.camera,
            self.field,
            self_absorption=self.self_absorption,
            absorption=self.absorption,
            absorber=self.absorber,
            bending=self.bending,
        )

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
