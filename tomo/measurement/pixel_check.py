"""What single images show by themselves: bad pixels, saturation, dark levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.measurement.background import background, below_zero
from tomo.measurement.noise_model import NoiseModel, estimate_noise
from tomo.measurement.outlier_pixels import find_outlier_pixels
from tomo.measurement.saturation import cut_off_level

NOTEWORTHY = 1e-3
"""Fraction of a view's pixels that are outliers, above which a warning names the camera."""


@dataclass(frozen=True, eq=False)
class PixelCheck:
    """The pixels of some images that can be used, and what is wrong with the others.

    Attributes
    ----------
    masks : tuple of (height, width) bool
        One a camera: True where a pixel is usable and no outlier.
    noise : tuple of NoiseModel
        One a camera.
    outliers, usable : mapping of str to int
        Camera to its number of outlier pixels, and of pixels that were usable.
    below_zero : mapping of str to float
        Camera to how far its dark regions lie below zero, in image units; only those that do.
    background : mapping of str to float
        Camera to the level of its image's uniform background; only cameras that have one.
    saturated : mapping of str to float
        Camera to the level that its image was cut off at; only those that were.
    """

    masks: tuple[NDArray[np.bool_], ...]
    noise: tuple[NoiseModel, ...]
    outliers: Mapping[str, int]
    usable: Mapping[str, int]
    below_zero: Mapping[str, float] = field(default_factory=dict)
    background: Mapping[str, float] = field(default_factory=dict)
    saturated: Mapping[str, float] = field(default_factory=dict)

    @property
    def warnings(self) -> list[str]:
        """One line for each finding that the user should act on."""
        return [*self._saturation(), *self._background(), *self._outliers(), *self._below_zero()]

    def _saturation(self) -> list[str]:
        return [
            f"camera {name}: its image is cut off at {level:.3g}, saturation: more pixels have "
            "that value than lie just below it. They are left out. Expose it shorter, or give the "
            "level in scan.yaml: corrections: saturation"
            for name, level in self.saturated.items()
        ]

    def _background(self) -> list[str]:
        if not self.background:
            return []
        worst = max(self.background, key=self.background.__getitem__)
        return [
            f"{len(self.background)} of {len(self.outliers)} cameras' images have a uniform "
            f"background, camera {worst} the highest ({self.background[worst]:.3g}). Subtract it, "
            "see the line on the dark level"
        ]

    def _outliers(self) -> list[str]:
        fractions = {name: n / max(self.usable[name], 1) for name, n in self.outliers.items()}
        worst = max(fractions, key=fractions.__getitem__, default=None)
        if worst is None or fractions[worst] <= NOTEWORTHY:
            return []
        total = sum(self.outliers.values()) / max(sum(self.usable.values()), 1)
        return [
            f"{total:.2%} of the pixels are outliers, camera {worst} has most "
            f"({fractions[worst]:.2%}): excluded. Mask what is not single pixels (scan.yaml, "
            "corrections: mask)"
        ]

    def _below_zero(self) -> list[str]:
        if not self.below_zero:
            return []
        worst = max(self.below_zero, key=self.below_zero.__getitem__)
        return [
            f"dark regions of {len(self.below_zero)} of {len(self.outliers)} cameras' images lie "
            f"below zero, camera {worst}'s most (by {self.below_zero[worst]:.3g}). Too much was "
            "subtracted as dark, and the volume is too faint. Check the dark frames, or lower the "
            "dark level in scan.yaml (corrections: dark) by that much"
        ]

    def report(self) -> dict[str, Any]:
        """Return plain numbers for report.json: counts, and levels in image units, by camera."""
        return {
            "outlier_pixels": dict(self.outliers),
            "below_zero": dict(self.below_zero),
            "background": dict(self.background),
            "saturated": dict(self.saturated),
        }


def check_pixels(
    names: Sequence[str],
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
) -> PixelCheck:
    """Find outlier pixels, saturation, and dark levels that are not zero, each image by itself.

    Parameters
    ----------
    names : sequence of str
        The cameras'.
    images : sequence of (height, width) float32
    masks : sequence of (height, width) bool
        True where a pixel is usable.
    """
    noise = tuple(estimate_noise(i, m) for i, m in zip(images, masks, strict=True))
    outliers = [find_outlier_pixels(i, m, n) for i, m, n in zip(images, masks, noise, strict=True)]
    clean = [m & ~o for m, o in zip(masks, outliers, strict=True)]
    tops = [cut_off_level(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    clean = [
        mask if top is None else mask & (image < top)
        for image, mask, top in zip(images, clean, tops, strict=True)
    ]
    depths = [below_zero(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    levels = [background(i, m, n) for i, m, n in zip(images, clean, noise, strict=True)]
    return PixelCheck(
        tuple(clean),
        noise,
        {name: int(np.count_nonzero(o)) for name, o in zip(names, outliers, strict=True)},
        {name: int(np.count_nonzero(m)) for name, m in zip(names, masks, strict=True)},
        {name: depth for name, depth in zip(names, depths, strict=True) if depth > 0},
        {name: level for name, level in zip(names, levels, strict=True) if level > 0},
        {name: top for name, top in zip(names, tops, strict=True) if top is not None},
    )
