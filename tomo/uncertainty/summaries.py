"""Quantities of a whole volume that people report: total, plane sums, edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, Volume, VoxelGrid

NAMES = ("total", "plane_sums_x", "plane_sums_y", "plane_sums_z", "edges")


def plane_sums(volume: NDArray, grid: VoxelGrid) -> list[NDArray[np.float64]]:
    """Return the integrals over the planes across x, y and z: ``(nx,)``, ``(ny,)``, ``(nz,)``."""
    found = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        area = float(np.prod([grid.spacing[other] for other in others]))
        found.append(volume.sum(axis=others, dtype=np.float64) * area)
    return found


def edges(volume: NDArray, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return where the emission begins and ends along each axis, ``(3, 2)`` in lengths.

    The outermost places at which the plane sums, linear between the planes, are half of their
    largest; the grid's faces where the outer planes are above that. NaN where nothing emits.
    """
    found = np.full((3, 2), np.nan)
    for axis, sums in enumerate(plane_sums(volume, grid)):
        if not sums.max() > 0:
            continue
        level = sums.max() / 2
        above = np.flatnonzero(sums >= level)
        for side, (inner, step) in enumerate(((above[0], -1), (above[-1], 1))):
            outer = inner + step
            if not 0 <= outer < len(sums):
                found[axis, side] = (grid.lower, grid.upper)[side][axis]
                continue
            part = (sums[inner] - level) / (sums[inner] - sums[outer])
            found[axis, side] = grid.axes()[axis][inner] + step * part * grid.spacing[axis]
    return found


def all_of(volume: NDArray, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return total, plane sums and edges in one row: ``(1 + nx + ny + nz + 6,)``."""
    sums = plane_sums(volume, grid)
    return np.concatenate([[Volume(volume, grid).total()], *sums, edges(volume, grid).ravel()])


def of_unknowns(unknowns: NDArray, active: ActiveVoxels) -> NDArray[np.float64]:
    """Return `all_of` the volume of some unknowns."""
    return all_of(active.expand(unknowns).reshape(active.grid.shape), active.grid)


def split(row: NDArray[np.float64], grid: VoxelGrid) -> dict[str, NDArray[np.float64]]:
    """Return the parts of a row of `all_of` by name."""
    parts = np.split(row, np.cumsum([1, *grid.shape]))
    named = dict(zip(NAMES, parts, strict=True))
    return named | {"total": named["total"][0], "edges": named["edges"].reshape(3, 2)}
