"""Surfaces of equal intensity, in world coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.draw.scene import Mesh, Scene, rgb
from tomo.draw.shapes import Triangles
from tomo.grid import Volume, VoxelGrid

LEVELS = (0.15, 0.4, 0.7)
"""Parts of the maximum at which surfaces are drawn unless others are asked for."""

# Light outside, dark inside, all readable on white; the outer ones are more transparent.
_LOOKS = (("#f6b04c", 0.22), ("#e2582f", 0.40), ("#8c1d4e", 0.85))


def isosurface(data: NDArray, grid: VoxelGrid, level: float) -> Triangles:
    """Return the closed surface ``data == level`` with normals pointing to lower values.

    ``data`` ``(nx, ny, nz)`` are values at the voxels' centres. Outside the grid the value is
    taken as zero, which closes the surface. It is empty where the level is nowhere reached.
    """
    if data.shape != grid.shape:
        raise ValueError(f"volume: found shape {data.shape}, expected the grid's {grid.shape}")
    if not level > 0:
        raise ValueError(f"isosurface level: found {level}, expected a number above zero")
    import open3d as o3d

    padded = np.pad(np.asarray(data, np.float32), 1)
    # Open3D names the first array axis z and returns (x, y, z): it gets the transposed array.
    tensor = o3d.core.Tensor.from_numpy(np.ascontiguousarray(padded.transpose(2, 1, 0)))
    surface = o3d.t.geometry.TriangleMesh.create_isosurfaces(tensor, [float(level)])
    index = surface.vertex.positions.numpy().astype(np.float64) - 1  # in voxels from the origin
    vertices = grid.origin + index * grid.spacing
    vertices = np.clip(vertices, grid.lower, grid.upper)
    return vertices, surface.triangle.indices.numpy().astype(np.int64)


def finite(volume: Volume) -> Volume:
    """Return the volume in single precision, 0 where it has no finite value."""
    data = np.asarray(volume, np.float32)
    return volume.like(np.nan_to_num(data, nan=0.0, posinf=0.0, neginf=0.0))


def coarsened(volume: Volume, max_voxels: int = 4_000_000) -> Volume:
    """Return the volume averaged over blocks, so that its surfaces stay small enough to show.

    Planes beyond the last whole block are left out.
    """
    factor, grid = 1, volume.grid
    while math.prod(max(n // factor, 1) for n in grid.shape) > max_voxels:
        factor += 1
    if factor == 1:
        return volume.astype(np.float32)
    shape = tuple(max(n // factor, 1) for n in grid.shape)
    steps = tuple(min(factor, n) for n in grid.shape)
    whole = tuple(slice(0, n * s) for n, s in zip(shape, steps, strict=True))
    nx, ny, nz = shape
    data = np.asarray(volume, np.float32)[whole]
    means = data.reshape(nx, steps[0], ny, steps[1], nz, steps[2]).mean(axis=(1, 3, 5))
    upper = grid.lower + np.multiply(grid.spacing, steps) * shape
    grid = VoxelGrid.from_bounds(shape, grid.lower, upper)
    return Volume(means, grid, volume.length_unit, volume.value_unit)


def reference_value(data: NDArray) -> float:
    """Return the value that levels are fractions of: the maximum without the brightest 0.01 %.

    A single hot voxel, as noise makes it, would otherwise hide everything else.
    """
    finite = data[np.isfinite(data)]
    if not finite.size or finite.max() <= 0:
        return 0.0
    bright = float(np.quantile(finite, 0.9999))
    return bright if bright > 0 else float(finite.max())


def isosurface_scene(volume: Volume, levels: Sequence[float] = LEVELS) -> Scene:
    """Return nested surfaces at up to three parts of the (robust) maximum; none if all is dark."""
    small = coarsened(finite(volume))
    reference = reference_value(small)
    meshes = []
    levels = sorted(levels)[-3:]
    for fraction, (colour, opacity) in zip(levels, _LOOKS[-len(levels) :], strict=True):
        if reference <= 0:
            break
        vertices, triangles = isosurface(small, small.grid, fraction * reference)
        if len(triangles):
            name = f"{fraction:.0%} of the maximum"
            group = f"isosurface {fraction:.0%}"
            meshes.append(Mesh(name, group, vertices, triangles, rgb(colour), opacity))
    return Scene(tuple(meshes), length_unit=volume.length_unit)
