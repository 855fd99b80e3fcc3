"""One camera's image beside its re-projection, and the figures of the two; those of a volume."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo import metrics
from tomo._compute.reductions import dot, norm


@dataclass(frozen=True, eq=False)
class View:
    """One camera's image beside its re-projection.

    Attributes
    ----------
    name : str
        The camera's.
    measured, reprojected : (rows, columns) float32
        In one unit.
    mask : (rows, columns) bool, optional
        True where a pixel is usable.
    held_out : bool
        Whether the view took no part, as was asked for.
    excluded : bool
        Whether the view took no part because the others contradict it.
    """

    name: str
    measured: NDArray
    reprojected: NDArray
    mask: NDArray | None = None
    held_out: bool = False
    excluded: bool = False

    def __post_init__(self) -> None:
        """Check that the images fit on each other."""
        for name in ("reprojected", "mask"):
            other = getattr(self, name)
            if other is not None and other.shape != self.measured.shape:
                raise ValueError(
                    f"view {self.name}: {name}: found shape {other.shape}, expected the "
                    f"measured image's {self.measured.shape}"
                )

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Which pixels count, ``(rows, columns)``."""
        finite = np.isfinite(self.measured) & np.isfinite(self.reprojected)
        return finite if self.mask is None else finite & self.mask

    @property
    def relative_residual(self) -> float:
        """``||measured - reprojected|| / ||measured||`` of usable pixels; NaN if all are dark."""
        measured, reprojected = self._usable_pixels()
        size = norm(measured)
        return norm(measured - reprojected) / size if size > 0 else math.nan

    @property
    def gain(self) -> float:
        """The factor on the re-projection that fits the measured image best; NaN if it is dark.

        A view that differs from 1 by more than the others was brighter or darker than they say.
        """
        measured, reprojected = self._usable_pixels()
        energy = dot(reprojected, reprojected)
        return dot(measured, reprojected) / energy if energy > 0 else math.nan

    def similarity(self, data_range: float) -> dict[str, float]:
        """Return PSNR, SSIM and cosine similarity over the whole image, unusable pixels dark."""
        measured = np.where(self.usable, self.measured, 0)
        reprojected = np.where(self.usable, self.reprojected, 0)
        figures = {
            "psnr": metrics.psnr(reprojected, measured, data_range=data_range),
            "cosine": metrics.cosine_similarity(reprojected, measured),
            "data_range": data_range,
        }
        if min(measured.shape) >= 7 and measured.any():  # the window of SSIM; dark is 0 / 0
            figures["ssim"] = metrics.ssim(reprojected, measured, data_range=data_range)
        return figures

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
