"""The displacement of each view from its prediction: whether cameras and images agree.

A camera whose pose, focal length, lens or pixel origin differs from the rig records an image
displaced from where the other views predict it. Each left-out view is predicted from the other
views, and the prediction is shifted and magnified onto the image. The displacement that this
takes, root mean square over the image's edges, measures the disagreement. A wrong pose moves the
whole image; a wrong focal length and most of a lens's distortion magnify it.

The magnification common to all views is subtracted. It is no error of the cameras: with few views,
and with noise, predictions are too wide, each about its own middle. Nor can images show a wrong
factor common to all focal lengths, because it only scales the volume. On an arc of few views the
excess width differs from view to view and is largest at the ends, and light from outside the grid
draws predictions towards it. The displacement that exact cameras would show is therefore
simulated, and only a displacement beyond it counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tomo.selfcal.registration import middle_of_edges, register, shift_and_zoom_motions

FEWEST_VIEWS = 4
"""Views that the comparison needs at least. Fewer views predict each other too poorly; asking for
more leaves small rigs without the test."""

TYPICAL, TYPICAL_NOISE = 0.6, 4.0
"""Root mean square displacement over all views above which cameras disagree with the images, in
pixels and in standard deviations of image noise. Lower, exact cameras raise a warning; higher,
camera errors of a pixel go unnoticed."""

SINGLE, SINGLE_NOISE = 1.5, 8.0
"""The same two limits for the worst single view. Both are higher than those of all views, because
the largest of many displacements is larger by chance."""

EXACT_MARGIN = 1.25
"""Multiple of the simulated displacements of exact cameras that displacements must exceed as well:
their mean square with its standard error, or the largest one. Lower, exact cameras on an arc raise
a warning; higher, real errors there go unnoticed."""

LEAST_ZOOM_ERROR = 1e-6
"""Least standard error of a magnification, in pixels: it bounds the weight of a view in the common
magnification. Lower, a view without residuals outweighs all others; higher, weights are equal."""


@dataclass(frozen=True, eq=False)
class Displacement:
    """The displacement of each view from where the other views predict it.

    Attributes
    ----------
    pixels : (views,) float64
        Root mean square over the image's edges, in recorded pixels; 0 where the image does not
        determine it.
    noise : (views,) float64
        Standard deviation of ``pixels`` from image noise alone; infinite where the image does not
        determine the displacement.
    exact_cameras : (views,) float64, optional
        The displacement that cameras exactly as in the rig would show, in recorded pixels: the
        larger one of light in the grid and of light beside it too. None where it was not
        computed.
    """

    pixels: NDArray[np.float64]
    noise: NDArray[np.float64]
    exact_cameras: NDArray[np.float64] | None = None

    @classmethod
    def of(
        cls,
        predicted: Iterable[NDArray],
        images: Iterable[NDArray],
        masks: Iterable[NDArray[np.bool_]],
        factor: int = 1,
    ) -> Self:
        """Measure the displacements of all views from their predictions.

        Parameters
        ----------
        predicted, images, masks : sequences of (rows, columns)
            Masks are True where an image is usable.
        factor : int
            Recorded pixels along the side of one of these pixels.
        """
        found = [
            register(p, image, mask, shift_and_zoom_motions(p.shape, middle_of_edges(p, mask)))
            for p, image, mask in zip(predicted, images, masks, strict=True)
        ]
        determined = [match for match in found if np.isfinite(match.covariance).all()]
        if determined:
            weights = [
                1 / max(match.covariance[2, 2], LEAST_ZOOM_ERROR**2) for match in determined
            ]
            common_zoom = np.average([match.amounts[2] for match in determined], weights=weights)
        pixels, noise = np.zeros(len(found)), np.full(len(found), math.inf)
        for number, match in enumerate(found):
            if match in determined:
                amounts = match.amounts - (0, 0, common_zoom)
                square = float(amounts @ match.squares @ amounts)
                pixels[number] = factor * math.sqrt(max(square, 0.0))
                noise[number] = factor * math.sqrt(np.trace(match.squares @ match.covariance))
        return cls(pixels, noise)

    @property
    def typical(self) -> float:
        """Root mean square over the views with a finite ``noise``, in recorded pixels."""
        return self._typical(self.pixels)

    def _typical(self, figures: NDArray[np.float64]) -> float:
        determined = figures[np.isfinite(self.noise)]
        return float(np.sqrt(np.mean(determined**2))) if len(determined) else 0.0

    @property
    def disagrees(self) -> bool:
        """Whether the displacements exceed noise and those of exact cameras."""
        if np.isfinite(self.noise).sum() < FEWEST_VIEWS:
            return False
        exact = np.zeros(len(self.noise)) if self.exact_cameras is None else self.exact_cameras
        squares = exact[np.isfinite(self.noise)] ** 2
        chance = float(squares.std()) / math.sqrt(len(squares))  # standard error of their mean
        typical = EXACT_MARGIN * math.sqrt(float(squares.mean()) + chance)
        largest, noise = EXACT_MARGIN * float(exact.max()), self._typical(self.noise)
        all_views = self.typical > max(TYPICAL, TYPICAL_NOISE * noise, typical)
        one_view = self.pixels > np.maximum(SINGLE_NOISE * self.noise, max(SINGLE, largest))
        return all_views or bool(one_view.any())

    def warning(self, names: Sequence[str], advice: str) -> str:
        """Return the warning for cameras that disagree: finding, size, and ``advice``."""
        worst = int(np.argmax(self.pixels))
        return (
            f"cameras and images disagree: the image of camera {names[worst]} lies "
            f"{self.pixels[worst]:.1f} pixels from where the other views predict it, the images "
            f"of all cameras {self.typical:.1f} pixels (RMS): {advice}"
        )

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the entries of the report as plain numbers, by the cameras' ``names``."""
        return {
            "pixels": dict(zip(names, self.pixels.tolist(), strict=True)),
            "noise": dict(zip(names, self.noise.tolist(), strict=True)),
            "exact_cameras": None
            if self.exact_cameras is None
            else dict(zip(names, self.exact_cameras.tolist(), strict=True)),
            "typical": self.typical,
            "disagrees": self.disagrees,
        }
