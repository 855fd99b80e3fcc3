"""What takes light away and emits none: a cloud to one side, a sheath around the flame."""

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
    """A round cloud beside the axis y.

    Parameters
    ----------
    grid : VoxelGrid
    depth : float
        Optical depth along a line through its middle.
    angle : float
        Where it is around the axis y, in radians.
    """

    grid: VoxelGrid
    depth: float
    angle: float

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the extinction at points."""
        half = self.grid.extent / 2
        away = 0.6 * half * np.array([np.cos(self.angle), 0, np.sin(self.angle)])
        width = 0.2 * min(half[0], half[2])
        square = np.square(np.asarray(points) - self.grid.center - away).sum(axis=-1) / width**2
        return self.depth / (ACROSS * width) * np.exp(-0.5 * square)


@dataclass(frozen=True)
class Sheath:
    """A hollow cylinder around the axis y.

    Parameters
    ----------
    grid : VoxelGrid
    depth : float
        Optical depth of its wall, once across.
    """

    grid: VoxelGrid
    depth: float

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the extinction at points."""
        half, width = self.grid.extent / 2, 1.5 * self.grid.spacing[0]
        away = np.asarray(points)[..., [0, 2]] - np.asarray(self.grid.center)[[0, 2]]
        radius = np.hypot(away[..., 0], away[..., 1]) - 0.88 * min(half[0], half[2])
        return self.depth / (ACROSS * width) * np.exp(-0.5 * np.square(radius / width))
