"""One camera's image beside its re-projection, the figures of both, and the peak for PSNR."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo import metrics
from tomo._compute.reductions import dot, norm
from tomo.measurement import NoiseModel, estimate_noise
from tomo.measurement.noise_model import SIDE, block_means
from tomo.pipeline.options import Options
from tomo.scan import Scan
from tomo.scan.images import Images, Masks

SURE = 1.5
"""Ratio of a residual to the noise up to which it may be noise: estimates are good to a quarter.
Lower: noise of a tenth is taken for light. Higher: weak faults in noisy images are overlooked."""


@dataclass(frozen=True, eq=False)
class View:
    """One camera's image beside its re-projection, ``(rows, columns)``, in one unit.

    Pixels out of sight of the grid say nothing of the volume: they count in whole images alone.
    """

    name: str
    measured: NDArray
    reprojected: NDArray
    mask: NDArray | None = None
    held_out: bool = False  # took no part, as was asked for
    excluded: bool = False  # took no part because the others contradict it
    noise: NoiseModel | None = None  # estimated from the image when None
    in_sight: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Check that the images fit on each other."""
        for name in ("reprojected", "mask", "in_sight"):
            other = getattr(self, name)
            if other is not None and other.shape != self.measured.shape:
                raise ValueError(
                    f"view {self.name}: {name}: found shape {other.shape}, expected the "
                    f"measured image's {self.measured.shape}"
                )

    @property
    def takes_part(self) -> bool:
        """Whether the volume was reconstructed from this view."""
        return not (self.held_out or self.excluded)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which pixels count, ``(rows, columns)``."""
        finite = np.isfinite(self.measured) & np.isfinite(self.reprojected)
        return finite if self.mask is None else finite & self.mask

    @property
    def _telling(self) -> NDArray[np.bool_]:
        return self.usable if self.in_sight is None else self.usable & self.in_sight

    @property
    def relative_residual(self) -> float:
        """``||measured - reprojected|| / ||measured||`` of usable pixels; NaN if all are dark."""
        measured, reprojected = self._usable_pixels()
        size = norm(measured)
        return norm(measured - reprojected) / size if size > 0 else math.nan

    @cached_property
    def _variance(self) -> NDArray[np.float64]:
        """The variance of the noise of every pixel, ``(rows, columns)``.

        By the finest structure in the image or in the residual, whichever has less: wide voxels
        give the residual steps, details finer than voxels stand in the image.
        """
        usable = self.usable
        whole = np.where(usable, self.reprojected, 0)
        if self.noise is not None:
            return self.noise.variance(whole)
        found = (estimate_noise(self.measured, usable, expected) for expected in (None, whole))
        each = (one.variance(np.maximum(whole, 0)) for one in found)
        return min(each, key=lambda variance: float(variance[usable].sum()))

    @property
    def relative_noise(self) -> float:
        """Root mean square of the image's noise over that of the image; NaN if it is dark."""
        size = norm(self._usable_pixels()[0])
        return math.sqrt(float(self._variance[self.usable].sum())) / size if size > 0 else math.nan

    @property
    def residual_over_noise(self) -> float:
        """The residual over the image's noise; infinite where there is none of it."""
        noise = self.relative_noise
        return self.relative_residual / noise if noise > 0 else math.inf

    @cached_property
    def beyond_noise(self) -> float:
        """The residual of means over 4 x 4 pixels that noise does not explain; NaN if dark.

        ``sqrt(max(r^2 - (n / 4)^2, 0)) / m`` with the root mean squares ``r`` of the residual's
        means, ``m`` of the image's, and ``n`` of the noise, of pixels that see the grid; zero up
        to `SURE` times ``n / 4``. Details finer than a voxel cancel in the means.
        """
        usable = self._telling
        measured = np.where(usable, self.measured, 0).astype(np.float64)
        residual = measured - np.where(usable, self.reprojected, 0)
        light, missed = block_means(measured, usable), block_means(residual, usable)
        side = SIDE
        if not len(light):
            light, missed, side = measured[usable], residual[usable], 1
        if not norm(light) > 0:
            return math.nan
        noise = math.sqrt(float(self._variance[usable].mean())) / side
        found = norm(missed) / math.sqrt(len(missed))
        if found <= SURE * noise:
            return 0.0
        return math.sqrt(found**2 - noise**2) * math.sqrt(len(light)) / norm(light)

    @property
    def gain(self) -> float:
        """The factor on the re-projection that fits the measured image best; NaN if it is dark."""
        measured, reprojected = self._usable_pixels()
        energy = dot(reprojected, reprojected)
        return dot(measured, reprojected) / energy if energy > 0 else math.nan

    @property
    def light(self) -> float:
        """The sum of the measured image over that of the re-projection; NaN if that is dark.

        It tells gains better than `gain`: views share one total, but a volume follows own details.
        """
        measured, reprojected = self._usable_pixels()
        total = float(reprojected.sum())
        return float(measured.sum()) / total if total > 0 else math.nan

    @cached_property
    def fitted(self) -> tuple[float, float, View] | None:
        """Gain and background that fit the image best, and the view with them; None if dark."""
        telling = self._telling
        measured, predicted = (
            image[telling].astype(np.float64) for image in (self.measured, self.reprojected)
        )
        spread = predicted - predicted.mean() if len(predicted) else predicted
        energy = dot(spread, spread)
        if not energy > 0:
            return None
        gain = dot(measured, spread) / energy
        level = float(measured.mean() - gain * predicted.mean())
        image = (gain * self.reprojected + level).astype(np.float32)
        return gain, level, replace(self, reprojected=image)

    def psnr(self, data_range: float) -> float:
        """Return the PSNR in decibels over the whole image, unusable pixels dark."""
        return metrics.psnr(*self._whole_images()[::-1], data_range=data_range)

    def held_out_figures(self, data_range: float) -> dict[str, Any]:
        """Return `similarity`, and under ``fitted`` the same with gain and background fitted."""
        found, own = self.similarity(data_range), None
        if self.fitted is not None:
            gain, level, view = self.fitted
            own = {"gain": gain, "background": level, **view.similarity(data_range)}
            own["beyond_noise"] = view.beyond_noise
        return found | {"fitted": own}

    def similarity(self, data_range: float) -> dict[str, float]:
        """Return PSNR, SSIM and cosine similarity over the whole image, unusable pixels dark."""
        measured, reprojected = self._whole_images()
        figures = {
            "psnr": metrics.psnr(reprojected, measured, data_range=data_range),
            "cosine": metrics.cosine_similarity(reprojected, measured),
            "data_range": data_range,
        }
        if min(measured.shape) >= 7 and measured.any():  # the window of SSIM; dark is 0 / 0
            figures["ssim"] = metrics.ssim(reprojected, measured, data_range=data_range)
        return figures

    def _whole_images(self) -> tuple[NDArray, NDArray]:
        usable = self.usable
        return np.where(usable, self.measured, 0), np.where(usable, self.reprojected, 0)

    def _usable_pixels(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        usable = self.usable
        return self.measured[usable].astype(np.float64), self.reprojected[usable].astype(
            np.float64
        )


def quality(volume: NDArray, truth: NDArray | None) -> dict[str, float]:
    """Return the figures of a volume against a truth; empty without one."""
    if truth is None:
        return {}
    total = float(truth.sum(dtype=np.float64))
    return {
        "cosine_distance": metrics.cosine_distance(volume, truth),
        "nrmse": metrics.nrmse(volume, truth),
        "total_ratio": float(volume.sum(dtype=np.float64)) / total if total else math.nan,
    }


STATED, BRIGHTEST = "stated", "brightest measured pixel"


@dataclass(frozen=True)
class Peak:
    """The largest value that images can have, for PSNR and SSIM."""

    value: float
    unit: str
    origin: str = STATED


def peak_in_words(peak: Mapping[str, Any]) -> str:
    """Return the ``peak`` of ``report.json`` in words."""
    return f"{peak['value']:.4g} {peak['unit']} ({peak['origin']})"


def with_unit(figure: str, text: str) -> str:
    """Return a figure of an image with its unit: PSNR is in decibels, others are fractions."""
    return f"{text} dB" if figure == "psnr" else text


def peak_of(
    scan: Scan, frame: str, frames: Iterable[Images], masks: Masks, options: Options
) -> Peak:
    """Return the option's peak, else the scan's, else the brightest usable pixel, corrected."""
    unit, stated = scan.image_unit(frame), options.peak or scan.peak
    if stated is not None:
        return Peak(stated, unit)
    brightest = max(
        float(image.max(where=mask, initial=0.0))
        for images in frames
        for image, mask in zip(images, masks, strict=True)
    )
    return Peak(max(brightest, float(np.finfo(np.float32).tiny)), unit, BRIGHTEST)
