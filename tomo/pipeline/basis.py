"""The unknowns of a reconstruction: the voxel basis or the linear basis, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.operators import LINEAR, STORED, VOXEL, LinearSystem
from tomo.pipeline.methods import AUTO, Method
from tomo.pipeline.options import Options
from tomo.selection.basis import error_ratio
from tomo.selection.choose import FEW_VIEWS

LARGEST_PIXEL = 0.62
"""Voxel edges that are between two lines where splines are taken without being asked for. Of
lines further apart a voxel's edges may fall between them or not, which no blur mends: 20 random
scenes of turbulent flames with finer pixels all came nearer to the truth by splines, to 0.71 of
the distance on average, 25 with larger ones to 0.96, eleven of them no nearer."""

MOST_WORK = 5
"""Times that of boxes that splines may take without being asked for: a voxel's shadow is of many
fine pixels, each of which gives some of its light to all of them."""


@dataclass(frozen=True)
class Basis:
    """Boxes or splines, and why.

    Attributes
    ----------
    name : str
    reason : str
    share : float
        The squared error of left-out views by splines over that by boxes; NaN where not judged.
    """

    name: str
    reason: str
    share: float = math.nan

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        share = None if math.isnan(self.share) else self.share
        return {"name": self.name, "reason": self.reason, "share": share}


def of_basis(
    system: LinearSystem, measured: NDArray[np.float32], options: Options, method: Method
) -> tuple[LinearSystem, Basis]:
    """Return the system of the unknowns that options ask for, or that the images ask for.

    Parameters
    ----------
    system : LinearSystem
        Of boxes.
    measured : (pixels,) float32
    options : Options
    method : Method
        That it is to be solved by.
    """
    if options.basis != AUTO:
        given = Basis(options.basis, "as asked for")
        splines = options.basis == LINEAR
        return (system.with_linear_basis(options.supersample) if splines else system), given
    against = _reason_against(system, options, method)
    if against:
        return system, Basis(VOXEL, against)
    return better_of(system, measured, options.supersample)


def better_of(
    system: LinearSystem, measured: NDArray[np.float32], supersample: int = 1
) -> tuple[LinearSystem, Basis]:
    """Return the system of the unknowns that predict left-out views better.

    Parameters
    ----------
    system : LinearSystem
        Of boxes.
    measured : (pixels,) float32
    supersample : int
        Rays along each side of a pixel.
    """
    against = _reason_for_boxes(system, supersample)
    if against:
        return system, Basis(VOXEL, against)
    try:
        splines = system.with_linear_basis(supersample)
    except ValueError as error:  # too large, or a camera beside which the grid's centre lies
        return system, Basis(VOXEL, str(error))
    share = error_ratio(splines.projector, system.projector, measured)
    if math.isnan(share):
        return system, Basis(VOXEL, "nothing to judge by")
    left = f"splines leave {share:.2f} of the squared error of left-out views"
    if share < 1:
        return splines, Basis(LINEAR, left, share)
    return system, Basis(VOXEL, left, share)


def _reason_against(system: LinearSystem, options: Options, method: Method) -> str:
    """Return why what is asked for rules splines out; empty where it does not."""
    if not method.through_lenses:
        return f"{method.name} goes line by line"
    if method.needs_midpoints and not options.freeze_encoder:
        if options.encoder is not None:
            return "encoders were trained on boxes"
        if system.projector.n_views > FEW_VIEWS:
            return "of many views the weights of boxes are learned"
    return ""


def _reason_for_boxes(system: LinearSystem, supersample: int) -> str:
    """Return why splines are not even tried; empty where they are."""
    if not system.projector.rows_are_single_rays:
        return "a lens's discs are told for boxes"
    if system.form != STORED:
        return "on the fly splines would take more memory than all the rest"
    grid = system.projector.grid
    apart = np.median(system.rig.footprint(grid.center)) / supersample
    edges = float(apart) / math.prod(grid.spacing) ** (1 / 3)
    if not edges <= LARGEST_PIXEL:
        return f"lines are {edges:.2f} voxels apart, more than {LARGEST_PIXEL}"
    across = 1 / (edges * supersample) + 1.5  # pixels, about, that a shadow reaches
    work = 1 + across**2 * system.projector.shape[0] / system.projector.n_segments
    if work > MOST_WORK:
        return f"in pixels so fine splines would be {work:.0f} times the work of boxes"
    return ""
