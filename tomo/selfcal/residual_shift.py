"""How far views lie from where the other views predict them: whether cameras and images agree.

Cameras that are not as the rig says, be it pose, focal length, lens or where pixels are counted
from, see things beside where the others do. A view left out, predicted from the others, is shifted
and enlarged onto its image: how far that moves it, root mean square over its edges, is the figure.
A wrong pose moves the whole image; focal length and most of a lens's distortion enlarge it.

What all views are enlarged by alike is none of the cameras' doing: few views, and noise, let
predictions spread. It is taken out; a rig whose focal lengths are all wrong by one factor makes a
larger or smaller volume, which no image contradicts. Few views on an arc spread unlike, those at
its ends the most: how far the images of a volume lie from what is predicted of them, seen by
cameras that are exactly as the rig says, is what exact cameras must be allowed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tomo._compute.by_camera import by_name
from tomo.selfcal.registration import register, ways_to_shift_and_zoom

FEWEST_VIEWS = 4
"""Fewer views predict each other's shapes too poorly."""

TYPICAL, TYPICAL_NOISE = 0.6, 4.0
"""Root mean square over all views, in pixels and in standard deviations, from which on the
cameras are said to disagree with the images. Without any error of the cameras it stays below 0.5
pixels up to noise of a tenth of the brightest pixel, and below 4 of those at twice that noise:
predictions are noisy too."""

SINGLE, SINGLE_NOISE = 1.5, 8.0
"""The same for the worst of the views."""

BEYOND = 1.25
"""Times what exact cameras would show, above which either figure must lie as well. Exact cameras
reached 1.1 times, four of them on an arc of 90 degrees before a smooth jet."""

EXACT = 1e-6
"""Pixels: no image says better than this how much it is enlarged, whatever its covariance."""


@dataclass(frozen=True, eq=False)
class Displacement:
    """How far each view lies from where the others predict it.

    Attributes
    ----------
    pixels : (views,) float64
        Root mean square over the image's edges, in recorded pixels; 0 where it shows nothing.
    noise : (views,) float64
        What noise in the image alone makes of it, standard deviation; infinite there.
    of_exact : (views,) float64, optional
        What cameras that are exactly as the rig says would show; None where it was not looked for.
    """

    pixels: NDArray[np.float64]
    noise: NDArray[np.float64]
    of_exact: NDArray[np.float64] | None = None

    @classmethod
    def of(
        cls,
        predicted: Iterable[NDArray],
        images: Iterable[NDArray],
        masks: Iterable[NDArray[np.bool_]],
        factor: int = 1,
    ) -> Self:
        """Return that of predictions of all views against their images.

        Parameters
        ----------
        predicted, images, masks : sequences of (rows, columns)
            Masks are True where an image is usable.
        factor : int
            Recorded pixels along a pixel's side.
        """
        found = [
            register(seen, image, mask, ways_to_shift_and_zoom(image.shape))
            for seen, image, mask in zip(predicted, images, masks, strict=True)
        ]
        known = [one for one in found if np.isfinite(one.covariance).all()]
        if known:
            certain = [1 / max(one.covariance[2, 2], EXACT**2) for one in known]
            spread = np.average([one.amounts[2] for one in known], weights=certain)
        pixels, noise = np.zeros(len(found)), np.full(len(found), math.inf)
        for number, one in enumerate(found):
            if one in known:
                own = one.amounts - (0, 0, spread)
                pixels[number] = factor * math.sqrt(max(own @ one.squares @ own, 0.0))
                noise[number] = factor * math.sqrt(np.trace(one.squares @ one.covariance))
        return cls(pixels, noise)

    @property
    def typical(self) -> float:
        """Root mean square over the views that show anything, in pixels."""
        return self._typical(self.pixels)

    def _typical(self, figures: NDArray[np.float64]) -> float:
        known = figures[np.isfinite(self.noise)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0

    @property
    def disagrees(self) -> bool:
        """Whether the cameras are not where, or not as, the rig says."""
        if np.isfinite(self.noise).sum() < FEWEST_VIEWS:
            return False
        allowed = np.zeros(len(self.pixels)) if self.of_exact is None else BEYOND * self.of_exact
        together = self.typical > max(
            TYPICAL, TYPICAL_NOISE * self._typical(self.noise), self._typical(allowed)
        )
        single = self.pixels > np.maximum(np.maximum(SINGLE, SINGLE_NOISE * self.noise), allowed)
        return together or bool(single.any())

    def warning(self, names: Sequence[str], advice: str) -> str:
        """Return what the user should know when they disagree, the cameras ``names``, and do."""
        worst = int(np.argmax(self.pixels))
        return (
            f"cameras and images disagree: camera {names[worst]} sees things "
            f"{self.pixels[worst]:.1f} pixels from where the others predict them, a camera on "
            f"average {self.typical:.1f}: {advice}"
        )

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return what a report says of it: plain numbers; ``names`` are the cameras'."""
        return {
            "pixels": by_name(names, self.pixels),
            "noise": by_name(names, self.noise),
            "of_exact": None if self.of_exact is None else by_name(names, self.of_exact),
            "typical": self.typical,
            "disagrees": self.disagrees,
        }
