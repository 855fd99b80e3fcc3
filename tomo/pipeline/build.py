"""Stage 5, build: the equations in the basis that they are solved in, and the pixels' weights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, PixelWeights, weigh_pixels
from tomo.operators import LINEAR, STORED, TRANSPARENT, VOXEL, Absorption, LinearSystem
from tomo.operators.gpu.names import ON_CPU
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.infer import given_absorption
from tomo.pipeline.methods import AUTO, Method
from tomo.pipeline.options import Options
from tomo.pipeline.place import at_device
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.pipeline.trace import TracedScan, through_gas
from tomo.scan.images import Images, Masks
from tomo.selection import Choice

MOST_WORK = 5
"""Largest work of the linear basis over that of the voxel basis at which it is taken. Footprints
of many fine pixels cost more; with a smaller bound flames in fine pixels lose accuracy."""


BLOCK = 2.0
"""Edge, in voxels, of the blocks of pixels that are left out together. Smaller ones are predicted
by their own neighbours, larger ones show what the other views leave open more than the noise."""


@dataclass(frozen=True)
class Basis:
    """The voxel basis or the linear basis, and why."""

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
    """Return the system, which is in the voxel basis, in the one asked for or linear if possible.

    ``against`` is why the method keeps voxels, ``variances`` those of the blur of each image.
    """
    if asked == LINEAR:
        return system.with_linear_basis(supersample, variances), Basis(LINEAR, "as asked for")
    if asked != AUTO or against:
        return system, Basis(VOXEL, against if asked == AUTO else "as asked for")
    return linear_where_possible(system, supersample, variances)


def linear_where_possible(
    system: LinearSystem, supersample: int = 1, variances: Sequence[float] | None = None
) -> tuple[LinearSystem, Basis]:
    """Return the system in the linear basis, or in the voxel basis with the reason against it."""
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


@dataclass(frozen=True, eq=False)
class WeightedSystem:
    """The equations to solve: an operator, the measured pixels, and the weights of these."""

    system: LinearSystem
    measured: NDArray[np.float32]
    weights: NDArray[np.float32] | None  # (pixels,), for methods that start from the default
    weighting: dict[str, Any]
    basis: Basis
    absorption: Absorption = TRANSPARENT
    choice: Choice | None = None  # the default's for just these equations, where known
    place: str = ON_CPU
    record: Record = Record()

    def only(self, rows: NDArray[np.bool_], system: LinearSystem) -> WeightedSystem:
        """Return the equations of some of the pixels, which have a system of their own."""
        weights = None if self.weights is None else self.weights[rows]
        return replace(self, system=system, measured=self.measured[rows], weights=weights)


def build(screened: ScreenedScan, traced: TracedScan, options: Options) -> WeightedSystem:
    """Choose the unknowns, weigh the pixels, take the equations through gas to their device."""
    methods = methods_of(options)
    with timed() as stage:
        against = "" if methods[0].through_lenses else f"{methods[0].name} goes ray by ray"
        found = screened.corrections
        system, basis = in_basis(
            traced.system, options.basis, options.supersample, against, found and found.blur
        )
        absorption = (
            given_absorption(screened.scan, options) if found is None else found.absorption
        )
        system = through_gas(system, absorption, screened.emission, options)
        system, place = at_device(system, options, methods)
        weights, weighting = _weighted(system, screened, methods)
    return WeightedSystem(
        system, traced.measured, weights, weighting, basis, absorption=absorption, place=place,
        record=stage.record,
    )  # fmt: skip


def weigh_images(
    rig: Rig, grid: VoxelGrid, images: Images, masks: Masks, noise: Sequence[NoiseModel]
) -> PixelWeights:
    """Weigh pixels by their noise and by what voxels, as wide as in the grid's middle, explain."""
    return weigh_pixels(images, masks, noise, max(grid.spacing) / rig.footprint(grid.center))


def _weighted(
    system: LinearSystem, screened: ScreenedScan, methods: list[Method]
) -> tuple[NDArray[np.float32] | None, dict[str, Any]]:
    """Return the weights of the pixels, ``(pixels,)``, None for equal ones, and the reason."""
    if not any(one.starts_from_default for one in methods):
        return None, {"used": False, "reason": "for the default method, and what starts from it"}
    rig, grid = screened.scan.rig, system.projector.grid
    found = weigh_images(rig, grid, screened.images, screened.masks, screened.noise)
    if found.images is None:
        return None, found.report()
    return system.flatten(found.images), found.report()
