"""What bends light on its way through a flame: gas that is hotter in the middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import VoxelGrid


class Bending(Protocol):
    """The gradient of a refractive index that is close to one."""

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the gradient ``(..., 3)`` per unit of length at ``points`` ``(..., 3)``."""


@dataclass(frozen=True)
class HotCore:
    """A column of hot gas around the axis y, whose index falls towards its middle.

    Parameters
    ----------
    grid : VoxelGrid
    shift : float
        By how many voxels the ray that is bent most is off where it leaves the grid, about.

    Notes
    -----
    The index is ``1 - s exp(-r² / 2 w²)``. A ray that passes the axis at the distance ``w`` is
    bent by the angle ``s sqrt(2 pi / e)``, the most there is.
    """

    grid: VoxelGrid
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
