"""Where rays meet voxels: three tracers that give the same segments.

``reference`` is the slow, readable float64 oracle, ``raycast`` asks Open3D's RaycastingScene, and
``march`` is the compiled walk that everything uses by default.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

if TYPE_CHECKING:
    from tomo.grid import VoxelGrid
    from tomo.rays import Rays
    from tomo.segments import Segments

TRACERS = ("march", "raycast", "reference")


def trace(
    rays: Rays,
    grid: VoxelGrid,
    tracer: str = "march",
    *,
    midpoints: bool = False,
    dtype: DTypeLike = np.float32,
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

    Raises
    ------
    ValueError
        If the tracer is unknown.
    """
    if tracer not in TRACERS:
        raise ValueError(f"tracer: found {tracer!r}, expected one of {', '.join(TRACERS)}")
    module = importlib.import_module(f"tomo.trace.{tracer}")
    return module.trace(rays, grid, midpoints=midpoints, dtype=dtype)
