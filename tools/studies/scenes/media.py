"""What light meets on its way: a cloud or a sheath that takes it away, gas that bends it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import VoxelGrid

ACROSS = np.sqrt(2 * np.pi)
"""Integral of a Gaussian along a line through its middle, over its width."""


class Absorber(Protocol):
    """Extinction in space, inside the grid of the emission that it dims."""

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the extinction ``(...)`` per unit of length at ``points`` ``(..., 3)``."""


@dataclass(frozen=True)
class Cloud:
    """A round cloud beside the axis y."""

    grid: VoxelGrid
    depth: float  # optical depth along a line through its middle
    angle: float  # where it is around the axis y, in radians

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the extinction at points."""
        half = self.grid.extent / 2
        away = 0.6 * half * np.array([np.cos(self.angle), 0, np.sin(self.angle)])
        width = 0.2 * min(half[0], half[2])
        square = np.square(np.asarray(points) - self.grid.center - away).sum(axis=-1) / width**2
        return self.depth / (ACROSS * width) * np.exp(-0.5 * square)


@dataclass(frozen=True)
class Sheath:
    """A hollow cylinder around the axis y."""

    grid: VoxelGrid
    depth: float  # optical depth of its wall, once across

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the extinction at points."""
        half, width = self.grid.extent / 2, 1.5 * self.grid.spacing[0]
        away = np.asarray(points)[..., [0, 2]] - np.asarray(self.grid.center)[[0, 2]]
        radius = np.hypot(away[..., 0], away[..., 1]) - 0.88 * min(half[0], half[2])
        return self.depth / (ACROSS * width) * np.exp(-0.5 * np.square(radius / width))


class Bending(Protocol):
    """The gradient of a refractive index that is close to one."""

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the gradient ``(..., 3)`` per unit of length at ``points`` ``(..., 3)``."""


@dataclass(frozen=True)
class HotCore:
    """A column of hot gas around the axis y, whose index falls towards its middle.

    Notes
    -----
    The index is ``1 - s exp(-r² / 2 w²)``. A ray that passes the axis at the distance ``w`` is
    bent by the angle ``s sqrt(2 pi / e)``, the most there is.
    """

    grid: VoxelGrid
    # by how many voxels the ray that is bent most is off where it leaves the grid, about
    shift: float

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the gradient at points."""
        half = min(self.grid.extent[0], self.grid.extent[2]) / 2
        width = half / 2
        strength = self.shift * self.grid.spacing[0] / half / np.sqrt(2 * np.pi / np.e)
        away = (np.asarray(points) - self.grid.center) * np.array([1.0, 0.0, 1.0])
        fall = np.exp(-0.5 * np.square(away).sum(axis=-1, keepdims=True) / width**2)
        return strength / width**2 * fall * away


def displacements(
    bending: Bending,
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    length: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how far rays are off the straight lines, ``(rays, count, 3)``.

    To first order in the bending: the gradient is that along the straight line.

    Parameters
    ----------
    bending : Bending
    points : (rays, count, 3)
        Along straight lines from the camera on, ``length`` ``(rays,)`` apart.
    directions : (rays, 3)
        Unit vectors.
    """
    across = bending(points)
    across -= (across * directions[:, None]).sum(axis=-1, keepdims=True) * directions[:, None]
    slope = np.cumsum(across, axis=1) - across / 2  # at the points, over the length
    return (np.cumsum(slope, axis=1) - slope / 2) * length[:, None, None] ** 2
