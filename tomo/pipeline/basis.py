"""The unknowns of a reconstruction: the voxel basis or the linear basis, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tomo.operators import LINEAR, STORED, VOXEL, LinearSystem
from tomo.pipeline.methods import AUTO

MOST_WORK = 5
"""Largest work of the linear basis over that of the voxel basis at which it is taken. Footprints
of many fine pixels cost more; with a smaller bound flames in fine pixels lose accuracy."""


BLOCK = 2.0
"""Edge, in voxels, of the blocks of pixels that are left out together. Smaller ones are predicted
by their own neighbours, larger ones show what the other views leave open more than the noise."""


@dataclass(frozen=True)
class Basis:
    """The voxel basis or the linear basis, and why.

    Attributes
    ----------
    name : str
    reason : str
    """

    name: str
    reason: str

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        return {"name": self.name, "reason": self.reason}


def in_basis(
    system: LinearSystem,
    asked: str,
    supersample: int,
    against: str,
    variances: Sequence[float] | None = None,
) -> tuple[LinearSystem, Basis]:
    """Return the system in the basis that is asked for, or linear where that is possible.

    Parameters
    ----------
    system : LinearSystem
        In the voxel basis.
    asked : {"auto", "voxel", "linear"}
    supersample : int
        Rays along each side of a pixel.
    against : str
        Why the method keeps the voxel basis; empty where it need not.
    variances : sequence of float, optional
        Of the blur of each camera's image, which the linear basis alone can have.
    """
    if asked == LINEAR:
        return system.with_linear_basis(supersample, variances), Basis(LINEAR, "as asked for")
    if asked != AUTO or against:
        return system, Basis(VOXEL, against if asked == AUTO else "as asked for")
    return linear_where_possible(system, supersample, variances)


def linear_where_possible(
    system: LinearSystem, supersample: int = 1, variances: Sequence[float] | None = None
) -> tuple[LinearSystem, Basis]:
    """Return the system in the linear basis, or in the voxel basis with the reason against it.

    Parameters
    ----------
    system : LinearSystem
        In the voxel basis.
    supersample : int
        Rays along each side of a pixel.
    """
    against = _reason_of_system(system, supersample)
    if against:
        return system, Basis(VOXEL, against)
    try:
        linear = system.with_linear_basis(supersample, variances)
    except ValueError as error:  # too large, or a camera beside which the grid's centre lies
        return system, Basis(VOXEL, str(error))
    return linear, Basis(LINEAR, "light has no edges of voxels")


def _reason_of_system(system: LinearSystem, supersample: int) -> str:
    """Return why the linear basis is not possible; empty where it is."""
    if not system.projector.rows_are_single_rays:
        return "a lens's blur is known for voxels alone"
    if system.form != STORED:
        return "on the fly the linear basis would take more memory than all the rest"
    grid = system.projector.grid
    apart = np.median(system.rig.footprint(grid.center)) / supersample
    edges = float(apart) / math.prod(grid.spacing) ** (1 / 3)
    across = 1 / (edges * supersample) + 1.5  # pixels, about, that a footprint reaches
    work = 1 + across**2 * system.projector.shape[0] / system.projector.n_segments
    if work > MOST_WORK:
        return f"in pixels so fine the linear basis would be {work:.0f} times the work"
    return ""
