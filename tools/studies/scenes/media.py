"""What light meets on its way: a cloud or a sheath that takes it away, gas that bends it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo import VoxelGrid

InSpace = Callable[[NDArray], NDArray]  # a function of points ``(..., 3)``
ACROSS = np.sqrt(2 * np.pi)
"""Integral of a Gaussian along a line through its middle, over its width."""


class Gas(NamedTuple):
    """What dims and bends light on its way to a camera."""

    # ``q``: the light of a point is dimmed by ``exp(-q E)``, ``E`` the integral of the emission
    # between the point and the camera
    self_absorption: float = 0.0
    # ``a``: it is dimmed by ``exp(-a L)`` too, ``L`` the length inside the field's grid
    absorption: float = 0.0
    # the extinction per unit of length inside the grid: ``exp`` of minus its integral dims as well
    absorber: InSpace | None = None
    # the gradient ``(..., 3)`` of a refractive index close to one, per unit of length: rays are
    # bent by a voxel at the most
    bending: InSpace | None = None


def cloud(grid: VoxelGrid, depth: float, angle: float) -> InSpace:
    """Return the extinction of a round cloud beside the axis y, ``angle`` radians around it.

    ``depth`` is the optical depth along a line through its middle.
    """
    half = grid.extent / 2
    middle = 0.6 * half * np.array([np.cos(angle), 0, np.sin(angle)])
    width = 0.2 * min(half[0], half[2])

    def extinction(points: NDArray) -> NDArray[np.float64]:
        square = np.square(points - grid.center - middle).sum(axis=-1) / width**2
        return depth / (ACROSS * width) * np.exp(-0.5 * square)

    return extinction


def sheath(grid: VoxelGrid, depth: float) -> InSpace:
    """Return the extinction of a hollow cylinder around the axis y, of a wall of such depth."""
    half, width = grid.extent / 2, 1.5 * grid.spacing[0]

    def extinction(points: NDArray) -> NDArray[np.float64]:
        away = points[..., [0, 2]] - np.asarray(grid.center)[[0, 2]]
        radius = np.hypot(away[..., 0], away[..., 1]) - 0.88 * min(half[0], half[2])
        return depth / (ACROSS * width) * np.exp(-0.5 * np.square(radius / width))

    return extinction


def hot_core(grid: VoxelGrid, shift: float) -> InSpace:
    """Return the gradient of a column of hot gas around the axis y: the index falls to its middle.

    The ray that is bent most is off by about ``shift`` voxels where it leaves the grid: the index
    is ``1 - s exp(-r² / 2 w²)``, and a ray that passes the axis at the distance ``w`` is bent by
    the angle ``s sqrt(2 pi / e)``, the most there is.
    """
    half = min(grid.extent[0], grid.extent[2]) / 2
    width = half / 2
    strength = shift * grid.spacing[0] / half / np.sqrt(2 * np.pi / np.e)

    def gradient(points: NDArray) -> NDArray[np.float64]:
        away = (points - grid.center) * np.array([1.0, 0.0, 1.0])
        fall = np.exp(-0.5 * np.square(away).sum(axis=-1, keepdims=True) / width**2)
        return strength / width**2 * fall * away

    return gradient


def displacements(
    bending: InSpace,
    points: NDArray[np.float64],  # (rays, count, 3), along straight lines from the camera on
    directions: NDArray[np.float64],  # (rays, 3), unit vectors
    length: NDArray[np.float64],  # (rays,), between two points
) -> NDArray[np.float64]:
    """Return how far rays are off the straight lines, ``(rays, count, 3)``.

    To first order in the bending: the gradient is that along the straight line.
    """
    across = bending(points)
    across -= (across * directions[:, None]).sum(axis=-1, keepdims=True) * directions[:, None]
    slope = np.cumsum(across, axis=1) - across / 2  # at the points, over the length
    return (np.cumsum(slope, axis=1) - slope / 2) * length[:, None, None] ** 2
