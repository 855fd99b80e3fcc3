"""Is a rig good enough for a volume, where is it not, and which camera is responsible."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.changes import recorded
from rigs.check.convention_errors import few_of, find_convention_errors
from rigs.check.coverage import PIXEL_ACCURACY, Coverage, coverage
from rigs.check.findings import findings
from rigs.check.grid_choice import shrinkable
from rigs.check.lines_of_sight import field_of_view, finite_rms
from rigs.check.resolved_wavelength import ViewsOfObject, box_covariance
from rigs.check.result import CameraFigures, Finding, RigCheck
from rigs.rig import Rig, Volume

MOST_POINTS = 3000
_LEAST_ALONG = 5  # points along an edge that has as many voxels


class Box(Protocol):
    """Members of a box of voxels that a check uses, as of `rigs.Volume` and `tomo.VoxelGrid`."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along x, y and z."""

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Edge lengths of a voxel."""

    @property
    def center(self) -> tuple[float, float, float]:
        """The middle of the box."""


def check_rig(
    rig: Rig, volume: Box | None = None, *, pixel_accuracy: float | None = None
) -> RigCheck:
    """Return whether a rig is good enough for a box of voxels, where it is not, and why.

    Parameters
    ----------
    rig : Rig
    volume : VoxelGrid or Volume, optional
        The rig's own when None.
    pixel_accuracy : float, optional
        RMS error of a line of sight in pixels, for rigs without a calibration's figures. When
        None, 0.2 is assumed, and a finding says so of cameras that nobody has measured.

    Raises
    ------
    ValueError
        If there is no camera or no volume, or the accuracy is not positive.

    Examples
    --------
    >>> from rigs import preset
    >>> check_rig(preset("paper33_pitch")).assessment
    'good'
    """
    volume = rig.volume if volume is None else volume
    if volume is None:
        raise ValueError("volume: found none, expected voxels, as the rig does not name any")
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one")
    box = Volume(volume.shape, volume.spacing, volume.center)
    coarse = lattice(box)
    # the outermost points lie on the faces of what they stand for half of
    ends = [np.where(np.isin(np.arange(n), (0, n - 1)) & (n > 1), 0.5, 1.0) for n in coarse.shape]
    check = check_points(
        rig,
        centers_of(coarse),
        np.multiply(box.shape, box.spacing),
        float(np.prod(box.spacing) ** (1 / 3)),
        pixel_accuracy=pixel_accuracy,
        weights=np.einsum("i,j,k->ijk", *ends).ravel(),
    )
    return replace(check, volume=box, lattice=coarse)


def convention_errors_in(rig: Rig, volume: Box) -> tuple[Finding, ...]:
    """Return the errors of unit and convention that `check_rig` finds, without the rest of it."""
    voxel = float(np.prod(volume.spacing) ** (1 / 3))
    return find_convention_errors(rig, few_of(centers_of(lattice(volume))), voxel)


def scale_for(rig: Rig, volume: Box) -> tuple[float, int] | None:
    """Return the width of a voxel in pixels and by how much images may be shrunk; None: not.

    The rule is that of `check_rig`, at few points of the volume.
    """
    footprint = coverage(rig, few_of(centers_of(lattice(volume)))).footprint
    sizes = [np.nanmedian(one) for one in footprint if np.isfinite(one).any()]
    if not sizes:
        return None
    pixel = float(np.median(sizes)) / float(np.prod(volume.spacing) ** (1 / 3))
    scale = shrinkable(pixel)
    return None if scale is None else (1 / pixel, scale)


def lattice(volume: Box, most: int = MOST_POINTS) -> Volume:
    """Return coarse voxels whose outermost centres are those of ``volume``.

    An edge of three voxels or more has an odd number of them, one in its middle.
    """
    voxels = np.array(volume.shape)
    low, high = 0.0, 1.0
    for _ in range(40):  # the ratio of the points to the voxels along each edge, by bisection
        ratio = (low + high) / 2
        low, high = (ratio, high) if _points_along(voxels, ratio).prod() <= most else (low, ratio)
    shape = _points_along(voxels, low)
    spacing = (voxels - 1) * volume.spacing / np.maximum(shape - 1, 1)
    spacing = np.where(shape > 1, spacing, voxels * volume.spacing)
    return Volume(tuple(shape.tolist()), tuple(spacing.tolist()), volume.center)


def centers_of(volume: Box) -> NDArray[np.float64]:
    """Return the centres of the voxels, ``(voxels, 3)``, z fastest."""
    axes = [
        middle + step * (np.arange(n) - (n - 1) / 2)
        for n, step, middle in zip(volume.shape, volume.spacing, volume.center, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _points_along(voxels: NDArray, ratio: float) -> NDArray[np.int64]:
    """Return the odd numbers of points along three edges."""
    wanted = np.maximum(np.ceil(voxels * ratio), np.minimum(voxels, _LEAST_ALONG)).astype(np.int64)
    return np.where(wanted > 2, wanted - (wanted % 2 == 0), wanted)


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
        As of `check_rig`.
    weights : (N,) array_like, optional
        Part of the volume that each point stands for; equal when None.
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
