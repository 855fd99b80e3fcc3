"""Stage 5, register: where cameras are, and the voxels that dark pixels prove empty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull import Carving, carve
from tomo.measurement import NoiseModel
from tomo.operators.system import Progress
from tomo.pipeline.frames import FrameImages, noise_of_frames, usable_in_all
from tomo.pipeline.hulls import HullRule, hull_of_frames, rule_of
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.refine import refine, sentence
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.selfcal.refine import Refinement


@dataclass(frozen=True, eq=False)
class Registered:
    """The rig, pixels and voxels to trace.

    Attributes
    ----------
    rig : Rig
        The cameras, refined where that was asked for.
    masks : sequence of (height, width) bool
        True where a pixel may take part.
    active : ActiveVoxels
        The voxels that may be other than zero.
    noise : tuple of NoiseModel
        That of one frame, for each camera.
    carving : Carving, optional
        How they were found: that of the middle frame. None where it was not asked for.
    rule : HullRule, optional
        How other frames are carved.
    refinement : Refinement, optional
        What was found of the cameras; None where it was not asked for.
    record : Record
    """

    rig: Rig
    masks: Sequence[NDArray[np.bool_]]
    active: ActiveVoxels
    noise: tuple[NoiseModel, ...]
    carving: Carving | None = None
    rule: HullRule | None = None
    refinement: Refinement | None = None
    record: Record = Record()

    def report(self, pixels_used: int) -> dict[str, Any]:
        """Return ``report.json``'s ``carving``: the pixels and voxels left out, and why."""
        recorded = sum(math.prod(camera.image_size) for camera in self.rig)
        counts = {"pixels_recorded": recorded, "pixels_used": pixels_used}
        return (
            counts if self.carving is None else {**counts, **self.carving.report(self.rig.names)}
        )

    def recorded_rig(self, scan: Scan) -> Rig | None:
        """Return the scan's rig as recorded, its cameras as they were found; None if as given."""
        found = {}
        if self.refinement and self.refinement.accepted:
            found["refined_from_images"] = self.refinement.report()
        if not found:
            return None
        cameras = []
        for camera in scan.rig:
            own = self.rig[camera.name] if camera.name in self.rig.names else camera
            cameras.append(scan.recorded_camera(own))
        known = {**(scan.rig.calibration or {}), **found}
        return replace(scan.rig, cameras=tuple(cameras), calibration=known)


def register(
    screened: ScreenedScan,
    frames: Sequence[FrameImages],
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str] = (),
    refining: Sequence[FrameImages] = (),
    progress: Progress | None = None,
) -> Registered:
    """Refine cameras and carve the volume, from images alone.

    Voxels are those that any of the frames may light, pixels those usable in all of them.

    Parameters
    ----------
    screened : ScreenedScan
        Of the mean of the frames.
    frames : sequence of FrameImages
        As corrected; a still is one.
    grid : VoxelGrid
    options : Options
    cameras : sequence of str
        Those to refine, if they take part.
    refining : sequence of FrameImages
        The frames that refine them and that judge, in turn; none: nothing is refined.
    progress : callable, optional
    """
    rig = screened.scan.rig
    noise = screened.noise if len(frames) == 1 else noise_of_frames(frames)
    masks, active, rule, carving = screened.masks, ActiveVoxels(grid), None, None
    with timed() as stage:
        refinement = refine(screened, refining, grid, options, cameras, progress)
        if refinement is not None:
            rig = refinement.rig
            if refinement.accepted or options.refine_cameras is not None:
                stage.warnings.append(sentence(refinement, -(-len(refining) // 2)))
        if options.skip:
            margin = math.inf if options.carving == OFF else options.carving
            found = [
                carve(tuple(rig), one.images, one.masks, grid, margin=margin, noise=noise)
                for one in frames
            ]
            carving = found[len(found) // 2]
            stage.warnings += carving.warnings
            rule, active, seen = rule_of(found, options), carving.active, list(carving.pixels)
            if len(frames) > 1:
                active, seen = hull_of_frames(rig, frames, grid, rule, noise)
            masks = usable_in_all([seen, masks])
    return Registered(rig, masks, active, noise, carving, rule, refinement, stage.record)
