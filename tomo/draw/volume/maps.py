"""Numbers in a box, shown as colours on its three middle planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import ColourScale, Mesh, Scene
from tomo.grid import Volume

MAP = "map: "
"""Prefix of groups of which one is shown at a time, because they lie on the same planes."""


def map_scene(values: Volume, name: str, scale: ColourScale) -> Scene:
    """Return the three middle planes, coloured by value; the group is ``map: name``.

    Parameters
    ----------
    values : Volume
        A plane between two layers of voxels shows their mean.
    name : str
    scale : ColourScale
    """
    grid, axes, meshes = values.grid, values.grid.axes(), []
    for across in range(3):
        level, upright = (axis for axis in range(3) if axis != across)
        if min(grid.shape[level], grid.shape[upright]) < 2:
            continue
        n = grid.shape[across]
        plane = np.take(values, [(n - 1) // 2, n // 2], axis=across).mean(axis=across)
        points = np.zeros((*plane.shape, 3))
        points[..., level], points[..., upright] = np.meshgrid(
            axes[level], axes[upright], indexing="ij"
        )
        points[..., across] = grid.center[across]
        side = "xyz"[across]
        meshes.append(
            Mesh(
                f"{name}, {side} = {grid.center[across] + 0.0:.4g}",
                MAP + name,
                points.reshape(-1, 3),
                lattice_triangles(*plane.shape),
                (0.5, 0.5, 0.5),
                values=plane.ravel(),
                scale=scale,
            )
        )
    return Scene(tuple(meshes), length_unit=values.length_unit)


def lattice_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the triangles ``(T, 3)`` between the points of a lattice, numbered row by row."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, below = corner + 1, corner + columns
    return np.concatenate(
        [np.stack([corner, below, right], axis=1), np.stack([right, below, below + 1], axis=1)]
    )
