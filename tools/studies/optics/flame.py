"""A flame that is quick to look up: nodes four to a voxel, and linear between them.

This interpolant, not what was sampled, is the truth: its line integrals and its voxel means
are then those of one field.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import convolve1d, map_coordinates, maximum_filter

import phantoms
from tomo import VoxelGrid

PER_VOXEL = 4
"""Nodes along a voxel's edge; a front of three voxels is then twelve nodes wide."""


@dataclass(frozen=True)
class Flame:
    """A turbulent flame that fills a grid of cubic voxels.

    Parameters
    ----------
    seed : int
        See `phantoms.TurbulentFlame`.
    grid : VoxelGrid
    """

    seed: int
    grid: VoxelGrid

    @cached_property
    def nodes(self) -> NDArray[np.float32]:
        """Emission at the nodes, ``(4 nx + 1, 4 ny + 1, 4 nz + 1)``, to the faces."""
        flame = phantoms.TurbulentFlame(self.seed, self.grid.extent, self.grid.center)
        x, y, z = (
            np.linspace(low, high, PER_VOXEL * n + 1)
            for low, high, n in zip(self.grid.lower, self.grid.upper, self.grid.shape, strict=True)
        )
        values = np.zeros((len(x), len(y), len(z)), np.float32)
        for number, place in enumerate(x):
            points = np.stack(np.meshgrid([place], y, z, indexing="ij"), axis=-1)
            values[number] = flame(points)[0]
        return values

    @property
    def spacing(self) -> float:
        """Length between two nodes."""
        return self.grid.spacing[0] / PER_VOXEL

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The box outside of which there is no light."""
        return self.grid.lower, self.grid.upper

    @cached_property
    def lit(self) -> NDArray[np.uint8]:
        """Whether a voxel holds light, ``(nx, ny, nz)``."""
        widest = maximum_filter(self.nodes, PER_VOXEL + 1)
        half = PER_VOXEL // 2
        return (widest[half::PER_VOXEL, half::PER_VOXEL, half::PER_VOXEL] > 0).astype(np.uint8)

    @cached_property
    def means(self) -> NDArray[np.float32]:
        """The means over the voxels, ``(nx, ny, nz)``: exact for a field linear between nodes."""
        weights = np.full(PER_VOXEL + 1, 1 / PER_VOXEL)
        weights[[0, -1]] /= 2
        values = self.nodes.astype(np.float64)
        for axis in range(3):
            values = convolve1d(values, weights, axis=axis)
        half = PER_VOXEL // 2
        return values[half::PER_VOXEL, half::PER_VOXEL, half::PER_VOXEL].astype(np.float32)

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)`` at ``points`` ``(..., 3)``, zero outside the grid."""
        places = (np.asarray(points, np.float64) - self.grid.lower) / self.spacing
        return map_coordinates(self.nodes, np.moveaxis(places, -1, 0), order=1, cval=0.0)
