"""How one image comes about: where its camera really stands, what it sees, what its lens does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rigs import Camera
from studies.scenes.fields import Field
from studies.scenes.forward import radiance

LIT = 0.02
"""Fraction of an image's maximum above which a pixel counts as showing the flame."""


@dataclass(frozen=True)
class Exposure:
    """What happens to the light on its way into one image.

    Attributes
    ----------
    camera : Camera
        As it really stands, which may differ from what the rig says.
    field : Field
    self_absorption, absorption : float
        See `studies.scenes.forward.radiance`.
    blur : float
        Standard deviation of a Gaussian blur, in pixels.
    vignetting : float
        Fraction of light lost in the corners; the loss grows with the square of the distance.
    hidden : float
        Fraction of the flame's width in the image behind an opaque frame, from the left.
    gain : float
    background : float
        Added to every pixel, as a fraction of full scale.
    saturation : float
        Fraction of the image's maximum that is the most it can record; not applied here, since
        noise comes first.
    mirrored : str
        ``""``, ``"across"``, ``"down"`` or ``"both"``: how the stored image is turned over.
    """

    camera: Camera
    field: Field
    self_absorption: float = 0.0
    absorption: float = 0.0
    blur: float = 0.0
    vignetting: float = 0.0
    hidden: float = 0.0
    gain: float = 1.0
    background: float = 0.0
    saturation: float = 1.0
    mirrored: str = ""

    @property
    def sight(self) -> tuple[Camera, Field, float, float]:
        """All that `light` depends on."""
        return self.camera, self.field, self.self_absorption, self.absorption

    def light(self) -> NDArray[np.float64]:
        """Return what arrives at the lens, ``(height, width)``, in the field's unit."""
        return radiance(
            self.camera,
            self.field,
            self_absorption=self.self_absorption,
            absorption=self.absorption,
        )

    def image(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the image without noise of ``light`` in units of full scale."""
        if self.hidden:
            light = np.where(self._behind_frame(light), 0, light)
        if self.blur:
            light = gaussian_filter(light, self.blur, mode="nearest")
        if self.vignetting:
            light = light * self._falloff(light.shape)
        if self.mirrored in ("across", "both"):
            light = light[:, ::-1]
        if self.mirrored in ("down", "both"):
            light = light[::-1]
        return self.gain * light + self.background

    def _behind_frame(self, light: NDArray[np.float64]) -> NDArray[np.bool_]:
        columns = np.flatnonzero((light > LIT * light.max()).any(axis=0))
        edge = columns[0] + self.hidden * (columns[-1] + 1 - columns[0])
        return np.broadcast_to(np.arange(light.shape[1]) < edge, light.shape)

    def _falloff(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        middle = (np.array(shape) - 1) / 2
        rows, columns = np.indices(shape)
        square = (rows - middle[0]) ** 2 + (columns - middle[1]) ** 2
        return 1 - self.vignetting * square / np.square(middle).sum()
