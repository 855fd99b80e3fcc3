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
"""Fraction of the brightest pixel up to which a pixel may be dark, without noise."""

FAINT = 0.002
"""Fraction of all light that dark pixels may hold together, without noise. Higher: a faint halo is
dark. Lower: the tails of every flame are bright, and less is carved."""

ENOUGH_AROUND = 0.01
"""Fraction of an image that must miss the grid before those pixels tell its level."""

SIGMAS_DARK = 2.0
"""Standard deviations of the smoothed noise up to which a pixel is dark."""

SIGMAS_CERTAIN = 5.0
"""Standard deviations above which a pixel is certainly bright, whatever the noise."""


@dataclass(frozen=True, eq=False)
class Brightness:
    """The images of a frame ``(height, width)``, divided into dark and bright pixels."""

    images: tuple[NDArray[np.float32], ...]  # smoothed
    usable: tuple[NDArray[np.bool_], ...]
    bright: tuple[NDArray[np.bool_], ...]  # above the threshold, or not usable
    certain: tuple[NDArray[np.bool_], ...]  # so bright that the volume must explain the pixel
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
        """Divide the pixels of all views by one threshold; noise is estimated where none is given.

        Noise sets the threshold. Where there is none, it is ``DARK`` of the median of the views'
        maxima, which one hot pixel does not change, or the level below which pixels hold ``FAINT``
        of the light, if that is lower. A Gaussian of standard deviation ``s`` divides that of
        white noise by ``2 sqrt(pi) s``; ``s`` is chosen to bring the noise down to the fraction
        ``DARK``, up to ``widest`` pixels: wider than a voxel it would blur the volume.
        """
        given = [None] * len(images) if masks is None else masks
        if noise is None:
            noise = [estimate_noise(i, m) for i, m in zip(images, given, strict=True)]
        usable = tuple(map(usable_pixels, images, given, noise))
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
            noise_free = SIGMAS_CERTAIN * gain * max(sigmas)
            level = min(floor, _level_of_faint_light(clean, noise_free))
            dark = max(level, SIGMAS_DARK * gain * max(sigmas))
        else:
            dark = float(threshold)
        certain = max(dark, SIGMAS_CERTAIN * gain * max(sigmas))
        pairs = list(zip(clean, usable, strict=True))
        return cls(
            tuple(clean),
            usable,
            tuple((image > dark) | ~good for image, good in pairs),
            tuple((image > certain) & good for image, good in pairs),
            dark,
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

    def carved_away(
        self,
        explained: Sequence[NDArray[np.bool_]],
        seen: Sequence[NDArray[np.bool_]],
        views: Sequence[int],
    ) -> float:
        """Return the fraction of the ``views``' light in ``seen`` that is not ``explained``.

        Both are one image a view: pixels that see any voxel, and an active one. Light counts above
        the median of the pixels that see no voxel: a level that the camera adds to all pixels is
        not carved away. Where noise was cut off at zero, dark pixels have the mean
        ``sigma / sqrt(2 pi)``, which is no light either. Two standard deviations of the sum are
        taken off: noise alone is no light.
        """
        light = lost = variance = 0.0
        for view in views:
            usable, image = self.usable[view], self.images[view]
            shown = usable & seen[view]
            level = self._dark_level(view, usable & ~seen[view])
            light += np.sum(image, where=shown, dtype=np.float64) - level * shown.sum()
            shown &= ~explained[view]
            lost += np.sum(image, where=shown, dtype=np.float64) - level * shown.sum()
            variance += self.noise[view].read ** 2 * shown.sum()
        lost -= SIGMAS_DARK * math.sqrt(variance)
        return max(lost / light, 0.0) if light > 0 else 0.0

    def _dark_level(self, view: int, around: NDArray[np.bool_]) -> float:
        """Return the mean of a view's dark pixels; ``around`` are those that see no voxel."""
        image, usable = self.images[view], self.usable[view]
        level = 0.0
        if np.count_nonzero(around) > ENOUGH_AROUND * image.size:
            level = max(float(np.median(image[around])), 0.0)
        if image.min(where=usable, initial=0.0) >= 0:
            level = max(level, self.noise[view].read / math.sqrt(2 * math.pi))
        return level


def _level_of_faint_light(images: Sequence[NDArray[np.float32]], least: float) -> float:
    """Return the level below which pixels above ``least`` hold `FAINT` of the light.

    Below ``least`` noise would count as light.
    """
    values = np.concatenate([image[image > least] for image in images])
    if not len(values):
        return math.inf
    values.sort()
    held = np.cumsum(values, dtype=np.float64)
    return float(values[np.searchsorted(held, FAINT * held[-1])])


def _blurred(
    image: NDArray[np.float32], usable: NDArray[np.bool_], sigma: float
) -> NDArray[np.float32]:
    """Return the Gaussian mean of the usable pixels around each pixel."""
    import cv2

    def blur(array: NDArray[np.float32]) -> NDArray[np.float32]:
        blurred = cv2.GaussianBlur(array, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(blurred, np.float32)

    total = blur(image)
    if usable.all():
        return total
    share = blur(usable.astype(np.float32))
    return np.divide(total, share, out=np.zeros_like(total), where=usable)
