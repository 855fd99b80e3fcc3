"""Stage 5, build: the equations in the basis that they are solved in, and the pixels' weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, PixelWeights, weigh_pixels
from tomo.operators import TRANSPARENT, Absorption, LinearSystem
from tomo.operators.gpu.names import ON_CPU
from tomo.pipeline.basis import Basis, in_basis
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.infer import given_absorption
from tomo.pipeline.methods import Method
from tomo.pipeline.options import Options
from tomo.pipeline.place import at_device
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.pipeline.trace import TracedScan, through_gas
from tomo.scan.images import Images, Masks
from tomo.selection import Choice


@dataclass(frozen=True, eq=False)
class WeightedSystem:
    """The equations to solve: an operator, the measured pixels, and the weights of these.

    Attributes
    ----------
    system : LinearSystem
        Through the gas that absorbs, where that was corrected.
    measured : (pixels,) float32
        Of the images as they were corrected.
    weights : (pixels,) float32, optional
        How much each pixel counts for the default method and what starts from it; None: all alike.
    weighting : mapping
        Whether pixels were weighted, and why.
    basis : Basis
    absorption : Absorption
        That of the system.
    choice : Choice, optional
        The default's for just these equations, where it is known already.
    place : str
        Where their products are computed, and why.
    record : Record
    """

    system: LinearSystem
    measured: NDArray[np.float32]
    weights: NDArray[np.float32] | None
    weighting: dict[str, Any]
    basis: Basis
    absorption: Absorption = TRANSPARENT
    choice: Choice | None = None
    place: str = ON_CPU
    record: Record = Record()


def build(screened: ScreenedScan, traced: TracedScan, options: Options) -> WeightedSystem:
    """Choose the unknowns and weigh the pixels, of images as given, through gas that is known.

    The equations go to a device here, where the options want that.
    """
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
    """Weigh the pixels of a rig's images by their noise and by what voxels can explain.

    See `tomo.measurement.weigh_pixels`; a voxel is as many pixels across as in the grid's middle.
    """
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
