"""The answer of a rig's check: coverage, figures of each camera, findings."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.check.coverage import PIXEL_ACCURACY, Coverage
from rigs.check.resolved_wavelength import ResolvedWavelength, ViewsOfObject, box_covariance
from rigs.rig import Volume


@dataclass(frozen=True)
class Finding:
    """One thing to know about a rig, and the ``cameras`` responsible, if any.

    ``level`` is "fault" (makes a reconstruction wrong), "warning" (limits it) or "note".
    """

    level: str
    text: str
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True)
class CameraFigures:
    """One camera's figures for the volume; NaN where one is unknown.

    Attributes
    ----------
    distance : float
        Distance from the middle of the volume.
    field_of_view : float
        Angle across the image's diagonal, degrees.
    sees : float
        Fraction of the volume in its image, 0 to 1.
    footprint, footprint_in_voxels : float
        Median size of a pixel in the volume.
    blur_in_pixels, blur_in_voxels : float
        The largest diameter of the defocus in the volume.
    nearest_view : float
        Angle modulo 180 degrees to the camera with the most similar line of sight.
    wavelength_without : float
        Growth without this camera of the wavelength down to which 90 % of all waves are measured,
        its median over the volume; infinite for the only camera.
    ray_miss : float
        Ray-miss of the camera's lines of sight as the calibration predicts; NaN without one.
    """

    name: str
    distance: float
    field_of_view: float
    sees: float
    footprint: float
    footprint_in_voxels: float
    blur_in_pixels: float
    blur_in_voxels: float
    nearest_view: float
    wavelength_without: float
    ray_miss: float = math.nan


@dataclass(frozen=True, eq=False)
class RigCheck:
    """The result of `check_rig`.

    Attributes
    ----------
    coverage : Coverage
        At points of the volume.
    extent : (3,) float64
        Edge lengths of the box.
    voxel : float
        A voxel's edge length; the geometric mean where edges differ.
    cameras : tuple of CameraFigures
    resolved : ResolvedWavelength
        The details that the views measure of a volume that emits everywhere.
    findings : tuple of Finding
        Faults first.
    ray_miss : float
        Expected RMS over the volume, in the length unit; NaN with fewer than two views.
    ray_miss_from : {"calibration", "pixel accuracy"}
    weights : (N,) float64
        Fractions of the volume that the points stand for; their sum is 1.
    volume, lattice : Volume, optional
        The voxels checked, and coarse ones with the points in the middle; None with given points.
    pixel_accuracy : float, optional
        RMS error of a line of sight in pixels, if given; else `PIXEL_ACCURACY` was assumed.
    """

    coverage: Coverage
    extent: NDArray[np.float64]
    voxel: float
    cameras: tuple[CameraFigures, ...]
    resolved: ResolvedWavelength
    findings: tuple[Finding, ...]
    ray_miss: float
    ray_miss_from: str
    weights: NDArray[np.float64]
    volume: Volume | None = None
    lattice: Volume | None = None
    pixel_accuracy: float | None = None

    @property
    def views_of_volume(self) -> ViewsOfObject:
        """The views of the whole volume, for the details that they measure at each point."""
        return self.coverage.views_of(box_covariance(self.extent), self.voxel)

    def fraction(self, points: NDArray[np.bool_]) -> float:
        """Return the fraction of the volume that a mask of the points ``(N,)`` stands for."""
        return float(self.weights @ points)

    @property
    def assessment(self) -> str:
        """``"good"``, ``"limited"`` where there is a warning, ``"not usable"`` with a fault."""
        levels = {finding.level for finding in self.findings}
        return "not usable" if "fault" in levels else "limited" if "warning" in levels else "good"

    def report(self) -> dict[str, Any]:
        """Return the figures as plain data; None where one is not known."""
        found = self.coverage
        seen = found.views > 0
        footprint = found.median_footprint[seen]
        pixel = float(np.median(footprint)) if len(footprint) else math.nan
        return {
            "assessment": self.assessment,
            "length_unit": found.rig.length_unit,
            "voxel": self.voxel,
            "views": {
                "least": int(found.views.min()),
                "median": float(np.median(found.views)),
                "most": int(found.views.max()),
                "unseen": self.fraction(~seen),
            },
            "resolved_wavelength": {
                name: _finite(value) if isinstance(value, float) else value
                for name, value in self.resolved.report().items()
            },
            "pixel_in_voxels": _finite(pixel / self.voxel),
            "ray_miss": _finite(self.ray_miss),
            "ray_miss_from": self.ray_miss_from,
            "pixel_accuracy": self.pixel_accuracy or PIXEL_ACCURACY,
            "findings": [asdict(finding) for finding in self.findings],
            "cameras": {
                figures.name: {
                    name: _finite(value)
                    for name, value in asdict(figures).items()
                    if name != "name"
                }
                for figures in self.cameras
            },
        }


def _finite(value: Any) -> float | None:
    """Return a number as JSON holds it: None for NaN and infinity."""
    return value if math.isfinite(value) else None
