"""The tracers by name: one call from rays and a grid to segments."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

if TYPE_CHECKING:
    from tomo.grid import ActiveVoxels, VoxelGrid
    from tomo.rays import Rays
    from tomo.trace.segments import Segments

TRACERS = ("march", "raycast", "reference")

MOST_VOXELS = 2**53
"""Voxel numbers are computed as float64 on the way: exact up to here."""


def trace(
    rays: Rays,
    grid: VoxelGrid,
    tracer: str = "march",
    *,
    midpoints: bool = False,
    dtype: DTypeLike = np.float32,
    active: ActiveVoxels | None = None,
) -> Segments:
    """Return the segments of rays: the voxels that each pixel's rays cross, and the lengths.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    tracer : {"march", "raycast", "reference"}
    midpoints : bool
        Whether to keep the midpoint of each segment too.
    dtype : {float32, float64}
        Of the lengths and midpoints; the geometry is always computed in float64.
    active : ActiveVoxels, optional
        All voxels of the grid when None. Segments in other voxels are left out, and ``voxel`` are
        the numbers of the unknowns.

    Raises
    ------
    ValueError
        If the tracer is unknown, the active voxels are those of another grid, or there are more
        voxels than can be numbered.
    """
    return tracing(grid, tracer, midpoints=midpoints, dtype=dtype, active=active)(rays)


def tracing(
    grid: VoxelGrid,
    tracer: str = "march",
    *,
    midpoints: bool = False,
    dtype: DTypeLike = np.float32,
    active: ActiveVoxels | None = None,
    in_storage_order: bool = False,
) -> Callable[[Rays], Segments]:
    """Return a function that traces rays as `trace` does, for one camera after another.

    Arguments and errors are those of `trace`. The tracer keeps working memory from call to call:
    two threads must not call it at once. Segments returned stay as they are. With
    ``in_storage_order``, ``voxel`` are the storage indices of the unknowns
    (`tomo.ActiveVoxels.storage_index`), where not all voxels are active.
    """
    if tracer not in TRACERS:
        raise ValueError(f"tracer: found {tracer!r}, expected one of {', '.join(TRACERS)}")
    if active is not None and active.grid != grid:
        raise ValueError(f"active: found voxels of {active.grid}, expected of {grid}")
    if grid.size > MOST_VOXELS:
        raise ValueError(f"grid shape: found {grid.shape}, expected at most 2^53 voxels to trace")
    module = importlib.import_module(f"tomo.trace.{tracer}")
    if tracer == "march":
        return module.March(
            grid,
            midpoints=midpoints,
            dtype=dtype,
            active=active,
            in_storage_order=in_storage_order,
        )

    def traced(rays: Rays) -> Segments:
        segments = module.trace(rays, grid, midpoints=midpoints, dtype=dtype)
        if active is None or active.all:
            return segments
        return segments.renumbered(
            active.storage_index_of_voxel if in_storage_order else active.number
        )

    return traced
