"""From images in memory to equations, timed: what a solver starts from."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo import LinearSystem, VoxelGrid
from tomo.hull import carve


@dataclass(frozen=True, eq=False)
class Problem:
    """The equations of a set of images.

    Attributes
    ----------
    system : LinearSystem
    measured : (pixels,) float32
    seconds : float
        From images in memory to here: finding what is dark, tracing, indexing.
    """

    system: LinearSystem
    measured: NDArray[np.float32]
    seconds: float


def problem(
    rig: Rig,
    grid: VoxelGrid,
    images: Sequence[NDArray[np.float32]],
    *,
    skip: bool,
    form: str = "stored",
    midpoints: bool = False,
) -> Problem:
    """Return the equations of all pixels and voxels, or of those that matter (``skip``)."""
    started = time.perf_counter()
    how: dict[str, Any] = {"form": form, "midpoints": midpoints}
    if skip:
        carving = carve(tuple(rig), images, None, grid)
        how |= {"masks": carving.pixels, "active": carving.active}
    system = LinearSystem.from_rig(rig, grid, skip=skip, **how)
    measured = system.flatten(images)
    return Problem(system, measured, time.perf_counter() - started)
