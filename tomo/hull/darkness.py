"""Which pixels are dark, and which are certainly bright."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tomo.measurement import NoiseModel, estimate_noise, usable_pixels

DARK = 0.005
"""Fraction of the brightest pixel up to which a pixel is dark, without noise."""

SIGMAS_DARK = 2.0
"""Standard deviations of the smoothed noise up to which a pixel is dark."""

SIGMAS_CERTAIN = 5.0
"""Standard deviations above which a pixel is certainly bright, whatever the noise."""


@dataclass(frozen=True, eq=False)
class Brightness:
    """The images of a frame, divided into dark and bright pixels.

    Attributes
    ----------
    images : tuple of (height, width) float32
        Smoothed.
    usable : tuple of (height, width) bool
    bright : tuple of (height, width) bool
        Above the threshold, or not usable: a dark voxel touches none of these.
    certain : tuple of (height, width) bool
        So bright that the volume must explain the pixel.
    threshold, smoothing : float
        In intensity and pixels; see `tomo.hull.Carving`.
    noise : tuple of NoiseModel
    """

    images: tuple[NDArray[np.float32], ...]
    usable: tuple[NDArray[np.bool_], ...]
    bright: tuple[NDArray[np.bool_], ...]
    certain: tuple[NDArray[np.bool_], ...]
    threshold: float
    smoothing: float
    noise: tuple[NoiseModel, ...]

    @classmethod
    def of(
        cls,
        images: Sequence[NDArray[np.floating]],
        masks: Sequence[NDArray[np.bool_]] | None,
        widest: float,
        threshold: float | str = "auto",
        noise: Sequence[NoiseModel] | None = None,
    ) -> Self:
        """Divide the pixels of all views by one threshold.

        Parameters
        ----------
        images, masks : sequence of (height, width)
        widest : float
            The largest standard deviation of the blur, in pixels; wider than a voxel it would
            blur the volume.
        threshold : float or "auto"
        noise : sequence of NoiseModel, optional
            One an image; estimated when None.

        Notes
        -----
        ``DARK`` is a fraction of the median of the views' maxima, which one hot pixel does not
        change. A Gaussian of standard deviation ``s`` divides that of white noise by
        ``2 sqrt(pi) s``; ``s`` is chosen to bring the noise down to the fraction ``DARK``, up to
        ``widest``.
        """
        masks = [None] * len(images) if masks is None else masks
        if noise is None:
            noise = [estimate_noise(i, m) for i, m in zip(images, masks, strict=True)]
        usable = tuple(map(usable_pixels, images, masks, noise))
        clean = [
            np.where(good, image, 0).astype(np.float32)
            for image, good in zip(images, usable, strict=True)
        ]
        maximum = float(np.median([image.max(initial=0.0) for image in clean]))
        floor = DARK * maximum
        sigmas = [math.sqrt(float(one.variance(floor))) for one in noise]
        sigma = float(np.median(sigmas))
        smoothing = 0.0
        if SIGMAS_DARK * sigma > floor > 0:
            smoothing = min(SIGMAS_DARK * sigma / floor / (2 * math.sqrt(math.pi)), widest)
        gain = 1.0
        if smoothing >= 0.5:  # a narrower Gaussian is only its middle pixel
            gain = 1 / (2 * math.sqrt(math.pi) * smoothing)
            clean = [_blurred(i, u, smoothing) for i, u in zip(clean, usable, strict=True)]
        else:
            smoothing = 0.0
        if threshold == "auto":
            threshold = max(floor, SIGMAS_DARK * gain * max(sigmas))
        certain = max(float(threshold), SIGMAS_CERTAIN * gain * max(sigmas))
        pairs = list(zip(clean, usable, strict=True))
        return cls(
            tuple(clean),
            usable,
            tuple((image > threshold) | ~good for image, good in pairs),
            tuple((image > certain) & good for image, good in pairs),
            float(threshold),
            smoothing,
            tuple(noise),
        )

    def unexplained(
        self, view: int, explained: NDArray[np.bool_], seen: NDArray[np.bool_]
    ) -> float:
        """Return the fraction of a view's certain light in ``seen`` that is not ``explained``."""
        certain = self.certain[view] & seen
        light = np.sum(self.images[view], where=certain, dtype=np.float64)
        lost = np.sum(self.images[view], where=certain & ~explained, dtype=np.float64)
        return float(lost / light) if light > 0 else 0.0


def _blurred(
    image: NDArray[np.float32], usable: NDArray[np.bool_], sigma: float
) -> NDArray[np.float32]:
    """Return the Gaussian mean of the usable pixels around each pixel."""
    import cv2

    def blur(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return cv2.GaussianBlur(array, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)

    total = blur(image)
    if usable.all():
        return total
    share = blur(usable.astype(np.float32))
    return np.divide(total, share, out=np.zeros_like(total), where=usable)
