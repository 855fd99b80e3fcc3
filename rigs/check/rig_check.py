"""Is a rig good enough for a volume, where is it not, and which camera is to blame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.camera import Camera
from rigs.check.angular_gap import angles_between, largest_gap
from rigs.check.coverage import PIXEL_ACCURACY, Coverage, coverage
from rigs.rig import Rig

_GAP_POINTS = 40  # of the volume, at which cameras are left out in turn
_SLIP_POINTS = 60


@dataclass(frozen=True)
class Finding:
    """One thing to know about a rig.

    Attributes
    ----------
    level : {"fault", "warning", "note"}
        A fault spoils a reconstruction; a warning limits it; a note does neither.
    text : str
        What was found and what it means.
    cameras : tuple of str
        Those to blame; empty where none is.
    """

    level: str
    text: str
    cameras: tuple[str, ...] = ()


@dataclass(frozen=True)
class CameraFigures:
    """What one camera does for the volume; NaN where a figure is not known.

    Attributes
    ----------
    name : str
    distance : float
        From the middle of the volume.
    field_of_view : float
        Degrees across the image's diagonal.
    sees : float
        Share of the volume's points in its image, 0 to 1.
    footprint : float
        Median size of a pixel in the volume.
    footprint_in_voxels : float
    blur_in_pixels, blur_in_voxels : float
        The largest in the volume.
    nearest_view : float
        Degrees, modulo 180, to the camera with the most similar lines of sight.
    gap_without : float
        By how much the largest angular gap, its median over the volume, would grow without this
        camera, in degrees.
    ray_miss : float
        Of the camera's lines of sight, as the calibration predicts; NaN without one.
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
    gap_without: float
    ray_miss: float = math.nan


@dataclass(frozen=True, eq=False)
class RigCheck:
    """The answer of `check_rig`.

    Attributes
    ----------
    coverage : Coverage
        At the volume's points.
    extent : (3,) float64
        Edge lengths of the box.
    voxel : float
        A voxel's edge length; the geometric mean where edges differ.
    cameras : tuple of CameraFigures
    findings : tuple of Finding
        Faults first.
    ray_miss : float
        Expected, RMS over the volume, in lengths; NaN with fewer than two views.
    ray_miss_from : {"calibration", "pixel accuracy"}
    weights : (N,) float64
        Parts of the volume that the points stand for, of sum 1.
    """

    coverage: Coverage
    extent: NDArray[np.float64]
    voxel: float
    cameras: tuple[CameraFigures, ...]
    findings: tuple[Finding, ...]
    ray_miss: float
    ray_miss_from: str
    weights: NDArray[np.float64]

    def share(self, points: NDArray[np.bool_]) -> float:
        """Return which part of the volume some of the points ``(N,)`` stand for, 0 to 1."""
        return float(self.weights @ points)

    @property
    def verdict(self) -> str:
        """``"good"``, ``"limited"`` where there is a warning, ``"not usable"`` with a fault."""
        levels = {finding.level for finding in self.findings}
        return "not usable" if "fault" in levels else "limited" if "warning" in levels else "good"


def check_rig(
    rig: Rig,
    points: ArrayLike,
    extent: ArrayLike,
    voxel: float,
    *,
    pixel_accuracy: float = PIXEL_ACCURACY,
    weights: ArrayLike | None = None,
) -> RigCheck:
    """Judge a rig by what it sees of a volume.

    Parameters
    ----------
    rig : Rig
    points : (N, 3) array_like
        Evenly all over the volume, its corners too.
    extent : (3,) array_like
        Edge lengths of the box that holds them.
    voxel : float
        A voxel's edge length, all in the rig's unit.
    pixel_accuracy : float
        RMS error of a line of sight in pixels, for rigs that bring no calibration's figures.
    weights : (N,) array_like, optional
        How much of the volume each point stands for; all alike when None.

    Raises
    ------
    ValueError
        As `coverage` does, or if a length is not positive.
    """
    extent = np.asarray(extent, np.float64)
    if extent.shape != (3,) or not (np.isfinite(extent) & (extent > 0)).all():
        raise ValueError(f"extent: found {extent.tolist()}, expected three positive lengths")
    if not (math.isfinite(voxel) and voxel > 0):
        raise ValueError(f"voxel: found {voxel}, expected a positive length")
    found = coverage(rig, points, pixel_accuracy=pixel_accuracy)
    weights = np.ones(len(found.points)) if weights is None else np.asarray(weights, np.float64)
    if weights.shape != (len(found.points),) or not (weights > 0).all():
        raise ValueError(f"weights: found shape {weights.shape}, expected a positive one a point")
    weights = weights / weights.sum()
    calibrated = calibrated_ray_miss(rig)
    miss = calibrated if calibrated is not None else _rms(found.ray_miss)
    check = RigCheck(
        found,
        extent,
        float(voxel),
        _figures(found, float(voxel), weights),
        (),
        miss,
        "pixel accuracy" if calibrated is None else "calibration",
        weights,
    )
    from rigs.check.findings import findings

    return replace(check, findings=findings(check))


def calibrated_ray_miss(rig: Rig, camera: str | None = None) -> float | None:
    """Return the ray-miss that the rig's calibration predicts, of all or of one camera.

    None without one, and where the rig counts in another unit by now.
    """
    summary = rig.calibration or {}
    if summary.get("length_unit", rig.length_unit) != rig.length_unit:
        return None
    if camera is None:
        value = summary.get("ray_miss_predicted")
    else:
        cameras = summary.get("cameras")
        own = cameras.get(camera) if isinstance(cameras, Mapping) else None
        value = own.get("ray_miss") if isinstance(own, Mapping) else None
    known = isinstance(value, (int, float)) and math.isfinite(value) and value > 0
    return float(value) if known else None


def short(value: float) -> str:
    """Return a number of two digits, without an exponent where it is large."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def some_of(points: NDArray, count: int) -> NDArray[np.int64]:
    """Return the numbers of about ``count`` of the points, spread evenly over their order."""
    return np.unique(np.linspace(0, len(points) - 1, min(count, len(points))).round().astype(int))


def slip_points(found: Coverage) -> NDArray[np.float64]:
    """Return the few points at which slips of unit and convention are looked for."""
    return found.points[some_of(found.points, _SLIP_POINTS)]


def angles_to_middle(found: Coverage) -> NDArray[np.float64]:
    """Return the angles between cameras' lines to the volume's middle, ``(C, C)``."""
    away = found.points.mean(axis=0) - np.array([camera.position for camera in found.rig])
    return angles_between(away)


def _figures(found: Coverage, voxel: float, weights: NDArray) -> tuple[CameraFigures, ...]:
    """Return every camera's figures."""
    rig, middle = found.rig, found.points.mean(axis=0)
    between = angles_to_middle(found)
    worth = _gap_without(found)
    figures = []
    for number, camera in enumerate(rig):
        footprint = _nan(np.nanmedian, found.footprint[number])
        figures.append(
            CameraFigures(
                camera.name,
                float(np.linalg.norm(camera.position - middle)),
                field_of_view(camera),
                float(min(weights @ found.seen[number], 1.0)),
                footprint,
                footprint / voxel,
                _nan(np.nanmax, found.blur_in_pixels[number]),
                _nan(np.nanmax, found.blur[number]) / voxel,
                float(between[number].min()) if len(rig) > 1 else math.nan,
                float(worth[number]),
                calibrated_ray_miss(rig, camera.name) or math.nan,
            )
        )
    return tuple(figures)


def field_of_view(camera: Camera) -> float:
    """Return the angle in degrees between opposite corners' lines of sight; NaN beyond a lens."""
    width, height = camera.image_size
    corners = np.array([[0, 0], [width, height], [width, 0], [0, height]]) - 0.5
    rays = camera.rays(corners)[1]
    cosines = [float(rays[0] @ rays[1]), float(rays[2] @ rays[3])]
    return float(np.degrees(np.arccos(np.clip(min(cosines), -1, 1))))


def _gap_without(found: Coverage) -> NDArray[np.float64]:
    """Return by how much the median gap grows without each camera, ``(C,)``."""
    some = some_of(found.points, _GAP_POINTS)
    directions, seen = found.directions[some], found.seen[:, some].T
    gap = np.median(largest_gap(directions, seen)[0])
    grown = []
    for number in range(len(found.rig)):
        left = seen.copy()
        left[:, number] = False
        grown.append(np.median(largest_gap(directions, left)[0]) - gap)
    return np.maximum(grown, 0.0)


def _rms(values: NDArray) -> float:
    """Return the root mean square of the finite values; NaN without any."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _nan(function: object, values: NDArray) -> float:
    """Return ``function`` of the values; NaN where all are."""
    return float(function(values)) if np.isfinite(values).any() else math.nan
