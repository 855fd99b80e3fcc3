"""Stage 4, trace: the rays of the pixels that take part, and what these pixels measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.operators import STORED, Absorption, LinearSystem
from tomo.operators.system import Progress, VolumeNotSeenError
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.first_use import warm_up
from tomo.pipeline.options import Options
from tomo.pipeline.register import Registered
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed


@dataclass(frozen=True, eq=False)
class TracedScan:
    """The rays of the pixels that take part, and what these measured."""

    system: LinearSystem  # in the voxel basis, through transparent gas
    measured: NDArray[np.float32]  # (pixels,), as given
    first_use_seconds: float = 0.0  # of kernels that this stage compiled or loaded
    record: Record = Record()


def trace_views(
    screened: ScreenedScan,
    registered: Registered,
    grid: VoxelGrid,
    options: Options,
    progress: Progress | None = None,
) -> TracedScan:
    """Trace the pixels that take part, through a lens where it is out of focus."""
    with timed() as stage:
        methods = methods_of(options)
        try:
            system = LinearSystem.from_rig(
                registered.rig,
                grid,
                masks=registered.masks,
                active=registered.active,
                skip=options.skip,
                midpoints=any(one.needs_midpoints for one in methods),
                needs_matrix=any(one.needs_matrix for one in methods),
                tracer=options.tracer,
                **options.rays,
                form=options.projector,
                progress=progress,
            )
        except VolumeNotSeenError as error:
            held_out = f"; held out: {', '.join(options.hold_out)}" if options.hold_out else ""
            raise VolumeNotSeenError(f"{screened.scan.where}{error}{held_out}") from None
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
    return TracedScan(system, measured, first_use, stage.record)


def through_gas(
    system: LinearSystem,
    absorption: Absorption,
    volume: NDArray[np.float32] | None,
    options: Options,
) -> LinearSystem:
    """Return the equations, made with the options, through gas that absorbs, if any does."""
    if not absorption:
        return system
    return system.with_absorption(absorption, volume, **options.rays, tracer=options.tracer)


def blind_warnings(system: LinearSystem) -> list[str]:
    """Return a line for each camera of which no usable pixel sees the volume."""
    return [
        f"camera {name}: none of its usable pixels sees the volume. Check its pose, its mask and "
        "the grid (check-rig), or hold it out"
        for name in system.blind
    ]
