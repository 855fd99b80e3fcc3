"""The check of a rig in a box of voxels: points all over it, and what they stand for."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rigs.check.convention_errors import ConventionError, few_of, find_convention_errors
from rigs.check.coverage import coverage
from rigs.check.grid_choice import shrinkable
from rigs.check.result import RigCheck
from rigs.check.rig_check import check_points
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


def convention_errors_in(rig: Rig, volume: Box) -> tuple[ConventionError, ...]:
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

    Where an edge holds three voxels or more, an odd number of points stands along it, so that
    one lies in its middle.
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
