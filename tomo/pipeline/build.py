"""Stage 4, build: the equations of the pixels that take part, and what each pixel counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, PixelWeights, weigh_pixels
from tomo.operators import STORED, LinearSystem
from tomo.operators.system import Progress, VolumeNotSeenError
from tomo.operators.view_gains import Gains
from tomo.pipeline.advice import lines_for_gains
from tomo.pipeline.basis import Basis, in_basis, reason_of_method
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.first_use import warm_up
from tomo.pipeline.methods import AUTO, Method
from tomo.pipeline.options import Options
from tomo.pipeline.register import Registered
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.scan.scan import Images, Masks
from tomo.selfcal.gains import gains_worth_correcting


@dataclass(frozen=True, eq=False)
class WeightedSystem:
    """The equations to solve: an operator, the measured pixels, and the weights of these.

    Attributes
    ----------
    system : LinearSystem
    measured : (pixels,) float32
        Corrected by the gains, where there are any.
    weights : (pixels,) float32, optional
        How much each pixel counts for the default method and what starts from it; None: all alike.
    weighting : mapping
        Whether pixels were weighted, and why.
    basis : Basis
    gains : Gains, optional
        The views' gains and backgrounds that were corrected.
    trace_seconds : float
        The part of the stage that traced the rays.
    first_use_seconds : float
        Compiling or loading of kernels that this stage found itself in need of.
    record : Record
    """

    system: LinearSystem
    measured: NDArray[np.float32]
    weights: NDArray[np.float32] | None
    weighting: dict[str, Any]
    basis: Basis
    gains: Gains | None = None
    trace_seconds: float = 0.0
    first_use_seconds: float = 0.0
    record: Record = Record()


def build(
    screened: ScreenedScan,
    registered: Registered,
    grid: VoxelGrid,
    options: Options,
    progress: Progress | None = None,
) -> WeightedSystem:
    """Trace the pixels that take part, choose the unknowns and weigh the pixels."""
    methods = methods_of(options)
    with timed() as stage:
        with timed() as tracing:
            system = _traced(screened, registered, grid, options, methods, progress)
            if options.blur:
                system = system.with_lens_blur(options.blur)
            first_use = 0.0
            if system.form != STORED:
                first_use = warm_up(options.tracer, system.form)
        stage.warnings += blind_warnings(system)
        measured = system.flatten(screened.images)
        if not (measured > 0).any():
            stage.warnings.append(
                "no usable pixel that sees the volume is above 0: the volume is empty. Check the "
                "exposure, and whether too much is subtracted as dark"
            )
        gains = gains_worth_correcting(system.projector, measured, options.fit_gain)
        if gains:
            measured = gains.correct(system.projector, measured)
            stage.warnings += _warning_of_gains(gains, options.fit_gain, screened)
        against = reason_of_method(
            methods[0],
            system.projector.n_views,
            encoder=options.encoder is not None,
            freeze_encoder=options.freeze_encoder,
        )
        system, basis = in_basis(system, options.basis, options.supersample, against)
        weights, weighting = _weighted(system, screened, gains, options, methods)
    return WeightedSystem(
        system,
        measured,
        weights,
        weighting,
        basis,
        gains,
        tracing.seconds,
        first_use,
        stage.record,
    )


def weigh_images(
    rig: Rig, grid: VoxelGrid, images: Images, masks: Masks, noise: Sequence[NoiseModel]
) -> PixelWeights:
    """Weigh the pixels of a rig's images by their noise and by what voxels can explain.

    See `tomo.measurement.weigh_pixels`; a voxel is as many pixels across as in the grid's middle.
    """
    return weigh_pixels(images, masks, noise, max(grid.spacing) / rig.footprint(grid.center))


def blind_warnings(system: LinearSystem) -> list[str]:
    """Return a line for each camera of which no usable pixel sees the volume."""
    return [
        f"camera {name}: none of its usable pixels sees the volume. Check its pose, its mask and "
        "the grid (check-rig), or hold it out"
        for name in system.blind
    ]


def _traced(
    screened: ScreenedScan,
    registered: Registered,
    grid: VoxelGrid,
    options: Options,
    methods: list[Method],
    progress: Progress | None,
) -> LinearSystem:
    """Return the equations of the views that take part, in the voxel basis and in focus."""
    try:
        return LinearSystem.from_rig(
            registered.rig,
            grid,
            masks=registered.masks,
            active=registered.active,
            skip=options.skip,
            midpoints=any(one.needs_midpoints for one in methods),
            needs_matrix=any(one.needs_matrix for one in methods),
            tracer=options.tracer,
            supersample=options.supersample,
            form=options.projector,
            progress=progress,
        )
    except VolumeNotSeenError as error:
        held_out = f"; held out: {', '.join(options.hold_out)}" if options.hold_out else ""
        raise VolumeNotSeenError(f"{screened.scan.source}: {error}{held_out}") from None


def _weighted(
    system: LinearSystem,
    screened: ScreenedScan,
    gains: Gains | None,
    options: Options,
    methods: list[Method],
) -> tuple[NDArray[np.float32] | None, dict[str, Any]]:
    """Return the weights of the pixels, ``(pixels,)``, None for equal ones, and the reason."""
    if not options.pixel_weights:
        return None, {"used": False, "reason": "not asked for"}
    if not any(one.name == AUTO or one.starts_from_default for one in methods):
        return None, {"used": False, "reason": "for the default method, and what starts from it"}
    rig, grid = screened.scan.rig, system.projector.grid
    found = weigh_images(rig, grid, screened.images, screened.masks, screened.noise)
    if found.images is None:
        return None, found.report()
    weights = system.flatten(found.images)
    if gains:
        weights = gains.correct_weights(system.projector, weights)
    return weights, found.report()


def _warning_of_gains(gains: Gains, asked: bool | None, screened: ScreenedScan) -> list[str]:
    if asked:
        return []
    scan = screened.scan
    lines = lines_for_gains(gains, scan.rig.names, scan.corrections)
    advice = (
        f"To have it in the scan, write into scan.yaml: {' and '.join(lines)}"
        if lines
        else "See report.json, gains, and check exposures and dark frames"
    )
    return [
        f"the cameras' gains differ by {gains.disagreement:.1%}, or their backgrounds: both were "
        f"fitted and corrected. {advice}"
    ]
