"""Stage 4, register: cameras that are to be refined, and voxels that dark pixels prove empty."""

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
from tomo.operators.system import Progress
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.selfcal.refine import Refinement, refine_cameras


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
    carving, refinement : optional
        How they were found; None where it was not asked for.
    record : Record
    """

    rig: Rig
    masks: Sequence[NDArray[np.bool_]]
    active: ActiveVoxels
    carving: Carving | None = None
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
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str] = (),
    progress: Progress | None = None,
) -> Registered:
    """Carve the volume and, where that is asked for, refine cameras, from the images alone.

    Parameters
    ----------
    screened : ScreenedScan
    grid : VoxelGrid
    options : Options
    cameras : sequence of str
        Those to refine, if they take part.
    progress : callable, optional
    """
    rig, images, masks = screened.scan.rig, screened.images, screened.masks
    refined = tuple(name for name in cameras if name not in screened.excluded)
    refinement, carving, active = None, None, ActiveVoxels(grid)
    with timed() as stage:
        if refined:
            refinement = refine_cameras(
                rig,
                images,
                grid,
                masks=masks,
                skip=options.skip,
                cameras=refined,
                prior_pixels=options.refine_prior,
                progress=progress,
            )
            rig = refinement.rig
            stage.warnings.append(_of_refinement(refinement))
        if options.skip:
            margin = math.inf if options.carving == OFF else options.carving
            carving = carve(tuple(rig), images, masks, grid, margin=margin, noise=screened.noise)
            masks, active = carving.pixels, carving.active
            stage.warnings += carving.warnings
    return Registered(rig, masks, active, carving, refinement, stage.record)


def _of_refinement(found: Refinement) -> str:
    names = ", ".join(found.cameras)
    if found.accepted:
        return (
            f"cameras refined from the images: {names}: {found.reason}. Use refined_rig.yaml for "
            "further frames"
        )
    return (
        f"cameras stay as the rig says: {names}: {found.reason}. Leave --refine-cameras out, or "
        "name other cameras"
    )
