"""Is a rig good enough for a volume, where is it not, and which camera is responsible."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.changes import recorded
from rigs.check.coverage import PIXEL_ACCURACY, Coverage, coverage
from rigs.check.findings import findings
from rigs.check.lines_of_sight import field_of_view, finite_rms
from rigs.check.resolved_wavelength import ViewsOfObject, box_covariance
from rigs.check.result import CameraFigures, RigCheck
from rigs.rig import Rig


def check_points(
    rig: Rig,
    points: ArrayLike,
    extent: ArrayLike,
    voxel: float,
    *,
    pixel_accuracy: float | None = None,
    weights: ArrayLike | None = None,
) -> RigCheck:
    """Evaluate a rig by what it sees of points of a volume; `check_rig` chooses them.

    Parameters
    ----------
    rig : Rig
    points : (N, 3) array_like
        Evenly spread over the volume, corners included.
    extent : (3,) array_like
        Edge lengths of the box that holds them.
    voxel : float
        A voxel's edge length, all in the rig's unit.
    pixel_accuracy : float, optional
        RMS error of a line of sight in pixels, for rigs without a calibration's figures;
        `PIXEL_ACCURACY` when None.
    weights : (N,) array_like, optional
        Part of the volume that each point stands for; equal when None.

    Raises
    ------
    ValueError
        As `coverage` raises, or if a length is not positive.
    """
    extent = np.asarray(extent, np.float64)
    if extent.shape != (3,) or not (np.isfinite(extent) & (extent > 0)).all():
        raise ValueError(f"extent: found {extent.tolist()}, expected three positive lengths")
    if not (math.isfinite(voxel) and voxel > 0):
        raise ValueError(f"voxel: found {voxel}, expected a positive length")
    accuracy = PIXEL_ACCURACY if pixel_accuracy is None else pixel_accuracy
    found = coverage(rig, points, pixel_accuracy=accuracy)
    parts = np.ones(len(found.points)) if weights is None else np.asarray(weights, np.float64)
    if parts.shape != (len(found.points),) or not (parts > 0).all():
        raise ValueError(f"weights: found shape {parts.shape}, expected a positive one per point")
    parts = parts / parts.sum()
    calibrated = calibrated_ray_miss(rig)
    miss = calibrated if calibrated is not None else finite_rms(found.ray_miss)
    views = found.views_of(box_covariance(extent), float(voxel))
    check = RigCheck(
        found,
        extent,
        float(voxel),
        _figures(found, views, parts),
        views.resolved(parts),
        (),
        miss,
        "pixel accuracy" if calibrated is None else "calibration",
        parts,
        pixel_accuracy=pixel_accuracy,
    )
    return replace(check, findings=findings(check))


def calibrated_ray_miss(rig: Rig, camera: str | None = None) -> float | None:
    """Return the ray-miss that the rig's calibration predicts, for all cameras or one.

    None without a calibration, and where the rig is now in another length unit.
    """
    summary = rig.calibration or {}
    if summary.get("length_unit", rig.length_unit) != rig.length_unit:
        return None
    return recorded(rig, "ray_miss_predicted" if camera is None else "ray_miss", camera)


def _figures(found: Coverage, views: ViewsOfObject, weights: NDArray) -> tuple[CameraFigures, ...]:
    """Return every camera's figures."""
    rig, middle, voxel = found.rig, found.points.mean(axis=0), views.voxel
    between = found.angles_to_middle()
    growth = views.growth_without()
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
                float(growth[number]),
                calibrated_ray_miss(rig, camera.name) or math.nan,
            )
        )
    return tuple(figures)


def _nan(function: Callable[[NDArray], np.floating], values: NDArray) -> float:
    """Return ``function`` of the values; NaN where none is finite."""
    return float(function(values)) if np.isfinite(values).any() else math.nan
