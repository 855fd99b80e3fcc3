"""Stage 3, register: where the cameras look, and which voxels dark pixels prove empty."""

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
from tomo.pipeline.options import OFF, Options
from tomo.pipeline.screen import ScreenedScan
from tomo.pipeline.stage import Record, timed
from tomo.scan import Scan
from tomo.selfcal.refine import Refinement, refine_cameras
from tomo.selfcal.shifts import Alignment, align_views


@dataclass(frozen=True, eq=False)
class Registered:
    """The rig, pixels and voxels to trace.

    Attributes
    ----------
    rig : Rig
        The cameras, shifted and refined where that was found worth it.
    masks : sequence of (height, width) bool
        True where a pixel may take part.
    active : ActiveVoxels
        The voxels that may be other than zero.
    alignment, carving, refinement : optional
        How they were found; None where it was not asked for.
    record : Record
    """

    rig: Rig
    masks: Sequence[NDArray[np.bool_]]
    active: ActiveVoxels
    alignment: Alignment | None = None
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
        if self.alignment and self.alignment.accepted:
            found["shifted_from_images"] = self.alignment.report(self.rig.names)
        if not found:
            return None
        cameras = []
        for camera in scan.rig:
            own = self.rig[camera.name] if camera.name in self.rig.names else camera
            cameras.append(scan.recorded_camera(own))
        known = {**(scan.rig.calibration or {}), **found}
        return replace(scan.rig, cameras=tuple(cameras), calibration=known)


def register(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    align: bool,
    margin: float | str | None,
    refining: dict[str, Any] | None = None,
    noise: Sequence[NoiseModel] | None = None,
    unmodelled_light: bool = False,
) -> Registered:
    """Align and refine the cameras and carve the volume, from the images alone.

    Parameters
    ----------
    rig, images, masks, grid
        Those of the cameras to reconstruct from.
    align : bool
        Whether to look for shifts of the cameras' images.
    margin : float or "auto", optional
        Pixels around an empty voxel that must be dark, see `tomo.hull.carve`; infinite: no voxel
        is empty. None: pixels that miss the grid are kept too.
    refining : dict, optional
        Settings of `tomo.selfcal.refine.refine_cameras`; nothing is refined when None.
    noise : sequence of NoiseModel, optional
        The noise of each image, where it is known already.
    unmodelled_light : bool
        Whether images show light that no volume in the grid explains, see `tomo.screening`.
    """
    if refining is not None and set(refining["cameras"]) >= set(rig.names):
        align = False  # refinement finds shifts too
    with timed() as stage:
        alignment = align_views(rig, images, grid, masks=masks) if align else None
        if alignment is not None:
            rig = alignment.rig(rig)
            stage.warnings += shift_warnings(alignment, rig, unmodelled_light)
        refinement = None
        if refining is not None:  # of the shifted images: the other cameras are in place
            skip = margin is not None
            refinement = refine_cameras(rig, images, grid, masks=masks, skip=skip, **refining)
            rig = refinement.rig
            stage.warnings.append(_of_refinement(refinement))
        carving, active = None, ActiveVoxels(grid)
        if margin is not None:
            carving = carve(tuple(rig), images, masks, grid, margin=margin, noise=noise)
            masks, active = carving.pixels, carving.active
            stage.warnings += carving.warnings
    return Registered(rig, masks, active, alignment, carving, refinement, stage.record)


def register_screened(
    screened: ScreenedScan,
    grid: VoxelGrid,
    options: Options,
    cameras: Sequence[str],
    progress: Progress | None = None,
) -> Registered:
    """Register the views that take part; ``cameras`` are those to refine, if they take part."""
    refined = tuple(name for name in cameras if name not in screened.excluded)
    refining = {"cameras": refined, "prior_pixels": options.refine_prior, "progress": progress}
    margin = math.inf if options.carving == OFF else options.carving
    return register(
        screened.scan.rig,
        screened.images,
        screened.masks,
        grid,
        align=options.align,
        margin=margin if options.skip else None,
        refining=refining if refined else None,
        noise=screened.noise if options.skip else None,
        unmodelled_light=screened.unmodelled_light,
    )


def displacement_warning(
    alignment: Alignment, names: Sequence[str], unmodelled_light: bool
) -> list[str]:
    """Return the line on views that lie off where the others predict them, if any do.

    Takes its time where it is asked for first, see `Alignment.displacement`.
    """
    displacement = alignment.displacement
    if displacement is None or not displacement.disagrees:
        return []
    advice = "calibrate again, or refine the cameras from the images"
    return [displacement.warning(names, _advice(advice, unmodelled_light))]


def shift_warnings(found: Alignment, rig: Rig, unmodelled_light: bool) -> list[str]:
    """Return the line on images that were shifted to agree, if they were."""
    if not found.accepted:
        return []
    lengths = np.linalg.norm(found.shifts, axis=1)
    worst = int(np.argmax(lengths))
    return [
        f"camera {rig.names[worst]} looks {lengths[worst]:.1f} pixels beside where the "
        f"rig says, others less: images were shifted to agree ({found.reason}): "
        f"{_advice('calibrate again', unmodelled_light)}"
    ]


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


def _advice(usual: str, unmodelled_light: bool) -> str:
    """Return what to do about cameras that seem wrong: unmodelled light makes them seem so."""
    if not unmodelled_light:
        return usual
    return f"see to the light that no volume explains first, and if this stays, {usual}"
