"""A surface of equal value with few enough triangles to be turned around smoothly."""

from __future__ import annotations

from numpy.typing import NDArray

from tomo.draw.shapes import Triangles
from tomo.draw.volume.isosurface import coarsened, isosurface
from tomo.grid import Volume, VoxelGrid

MOST_TRIANGLES = 100_000
"""Of one surface. Lower: a wrinkled flame loses wrinkles. Higher: the page turns slowly where no
graphics card helps, and each step of a slider sends more."""

COARSER = 4
"""Fewer voxels, from one try to the next: half as many along a side of a flat volume, and about
a third of the triangles."""


def light_surface(
    data: NDArray, grid: VoxelGrid, level: float, most: int = MOST_TRIANGLES
) -> Triangles:
    """Return the surface ``data == level``, of means over blocks where it is too fine.

    Parameters
    ----------
    data : (nx, ny, nz)
    grid : VoxelGrid
    level : float
        Above zero.
    most : int
        Triangles.

    Returns
    -------
    vertices : (V, 3) float64
        World coordinates; empty where the level is nowhere reached.
    triangles : (T, 3) int64
    """
    small = coarsened(Volume(data, grid))
    vertices, triangles = isosurface(small, small.grid, level)
    while len(triangles) > most and min(small.shape) > 2:
        small = coarsened(Volume(data, grid), small.size // COARSER)
        vertices, triangles = isosurface(small, small.grid, level)
    return vertices, triangles
