"""Where rays meet voxels: three tracers that give the same segments.

``reference`` is the slow, readable float64 oracle, ``raycast`` asks Open3D's RaycastingScene, and
``march`` is the compiled walk that everything uses by default.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

if TYPE_CHECKING:
    from tomo.grid import VoxelGrid
    from tomo.live_voxels import LiveVoxels
    from tomo.rays import Rays
    from tomo.segments import Segments

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
    live: LiveVoxels | None = None,
) -> Segments:
    """Return the voxels that each pixel's rays cross, and the length of every crossing.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    tracer : {"march", "raycast", "reference"}
    midpoints : bool
        Whether to keep the middle of each crossing too.
    dtype : {float32, float64}
        Of the lengths and midpoints; the geometry is always computed in float64.
    live : LiveVoxels, optional
        The voxels to look at; all of the grid when None. Crossings of others are left out, and
        ``voxel`` are the numbers of the live ones: those of the unknowns.

    Raises
    ------
    ValueError
        If the tracer is unknown, the live voxels are those of another grid, or there are more
        voxels than can be numbered.
    """
    return tracing(grid, tracer, midpoints=midpoints, dtype=dtype, live=live)(rays)


def tracing(
    grid: VoxelGrid,
    tracer: str = "march",
    *,
    midpoints: bool = False,
    dtype: DTypeLike = np.float32,
    live: LiveVoxels | None = None,
    by_place: bool = False,
) -> Callable[[Rays], Segments]:
    """Return what traces rays as `trace` does, to be called with one camera's after another's.

    Its arguments and errors are those of `trace`. The tracer keeps memory from call to call, so
    that no two threads may call it at once; what it has returned stays as it is. With ``by_place``
    the unknowns are numbered as `tomo.LiveVoxels.place` has them, where not all voxels are live.
    """
    if tracer not in TRACERS:
        raise ValueError(f"tracer: found {tracer!r}, expected one of {', '.join(TRACERS)}")
    if live is not None and live.grid != grid:
        raise ValueError(f"live: found voxels of {live.grid}, expected of {grid}")
    if grid.size > MOST_VOXELS:
        raise ValueError(f"grid shape: found {grid.shape}, expected at most 2^53 voxels to trace")
    module = importlib.import_module(f"tomo.trace.{tracer}")
    if tracer == "march":
        return module.March(grid, midpoints=midpoints, dtype=dtype, live=live, by_place=by_place)

    def traced(rays: Rays) -> Segments:
        segments = module.trace(rays, grid, midpoints=midpoints, dtype=dtype)
        if live is None or live.all:
            return segments
        return segments.renumbered(live.place_of_voxel if by_place else live.number)

    return traced
