"""Rays and voxels of a projection as they are copied to a device."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.gpu.device import NOTHING, Device
from tomo.operators.on_the_fly import OnTheFlyProjector


@dataclass(frozen=True, eq=False)
class DeviceRays:
    """Rays, voxels and gas on a device, which projectors of some of the pixels share.

    ``gas`` is the medium, extinction, depth outside the grid and ``is_first``, as kernels take
    them, ``absorption`` what it was made of, with the emission; empty where nothing absorbs.
    """

    rays: Any  # (N, 8) float64: origin, direction, length and weight
    is_first: Any  # (N,) uint8: whether a ray begins a path of light
    grid: Any  # (14,) float64: corners, spacing, shape; first plane walked along x, and behind it
    index: Any  # (unknowns,) int64: their voxels; `NOTHING` where all are
    active: Any  # (voxels,) uint8: whether a voxel is an unknown; `NOTHING` where all are
    most: float  # a bound of the sum of a voxel's lengths, ``max_v (A^T 1)_v``
    gas: tuple[Any, ...] = ()
    absorption: tuple[Any, ...] = ()


def copied_rays(
    projector: OnTheFlyProjector, device: Device
) -> tuple[Any, Any, NDArray[np.int64], float]:
    """Copy the rays of a projector to a device; return these, and a bound of a voxel's lengths.

    ``rays`` and ``is_first`` as of `DeviceRays`, where each pixel's begin (pixels + 1,), and the
    bound of the sum of the lengths in a voxel, negative where a weight is.
    """
    count = sum(source.ray_count(0, source.n_pixels) for source in projector._sources)
    rays, is_first = device.zeros((count, 8), np.float64), device.zeros((count,), np.uint8)
    ptr, weight, least, at = [np.zeros(1, np.int64)], 0.0, 0.0, 0
    for _, _, some in projector.some_rays():
        numbers = np.column_stack([some.origins, some.directions, some.lengths, some.weight])
        first = np.zeros(len(some), np.uint8)
        first[some.paths[:-1]] = 1
        here = slice(at, at + len(some))
        device.write(rays[here], numbers)
        device.write(is_first[here], first)
        ptr.append(at + some.pixel_ptr[1:])
        weight += float(np.abs(some.weight).sum())
        least = min(least, float(some.weight.min(initial=0.0)))
        at += len(some)
    diagonal = math.sqrt(float(np.square(projector.grid.spacing).sum()))
    most = math.copysign(weight * diagonal, -1.0 if least < 0 else 1.0)
    return rays, is_first, np.concatenate(ptr), most


def slab_of(active: ActiveVoxels, start: int, stop: int) -> ActiveVoxels:
    """Return the unknowns in some planes along x, on the grid of these planes alone."""
    grid = active.grid
    lower, upper = grid.lower.copy(), grid.upper.copy()
    lower[0], upper[0] = grid.lower[0] + np.array([start, stop]) * grid.spacing[0]
    slab = VoxelGrid.from_bounds((stop - start, *grid.shape[1:]), lower, upper)
    if active.index is None:
        return ActiveVoxels(slab)
    plane = grid.shape[1] * grid.shape[2]
    low, high = np.searchsorted(active.index, [start * plane, stop * plane])
    return ActiveVoxels(slab, active.index[low:high] - start * plane)


def voxels_of(
    grid: VoxelGrid, active: ActiveVoxels, device: Device, planes: range | None = None
) -> tuple[Any, Any, Any]:
    """Return ``grid``, ``index`` and ``active`` of `DeviceRays`, of a slab with its ``active``."""
    return (
        device.array(_numbers_of(grid, planes)),
        NOTHING if active.index is None else device.array(active.index),
        NOTHING if active.all else device.array(active.mask.ravel().astype(np.uint8)),
    )


def _numbers_of(grid: VoxelGrid, planes: range | None = None) -> NDArray[np.float64]:
    """Return a grid as the kernels take it, ``(14,)``, or a slab of it: some planes along x."""
    planes = range(grid.shape[0]) if planes is None else planes
    ends = planes.start, planes.stop
    return np.concatenate([grid.lower, grid.upper, grid.spacing, grid.shape, ends])
