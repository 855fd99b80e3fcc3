"""What is settled before anything is traced: where the cameras look, and what is surely empty."""

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
from tomo.scan import Scan
from tomo.selfcal.refine import Refinement, refine_cameras
from tomo.selfcal.shifts import Alignment, align_views


@dataclass(frozen=True, eq=False)
class Prepared:
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
    unmodelled_light : bool
        Whether images show light that no volume in the grid explains, see `tomo.suspects`.
    """

    rig: Rig
    masks: Sequence[NDArray[np.bool_]]
    active: ActiveVoxels
    alignment: Alignment | None = None
    carving: Carving | None = None
    refinement: Refinement | None = None
    unmodelled_light: bool = False

    @property
    def warnings(self) -> list[str]:
        """What the user should know of it."""
        return [*self._of_alignment(), *self._of_refinement()]

    def _of_refinement(self) -> list[str]:
        if self.refinement is None:
            return []
        names = ", ".join(self.refinement.cameras)
        if self.refinement.accepted:
            return [f"cameras refined from the images: {names}: {self.refinement.reason}"]
        return [f"cameras stay as the rig says: {names}: {self.refinement.reason}"]

    def _of_alignment(self) -> list[str]:
        found = self.alignment
        if found is None:
            return []
        displacement = found.displacement
        doubt = (
            [
                displacement.warning(
                    self.rig.names,
                    self._advice("calibrate again, or refine the cameras from the images"),
                )
            ]
            if displacement is not None and displacement.disagrees
            else []
        )
        if not found.accepted:
            return doubt
        lengths = np.linalg.norm(found.shifts, axis=1)
        worst = int(np.argmax(lengths))
        return [
            f"camera {self.rig.names[worst]} looks {lengths[worst]:.1f} pixels beside where the "
            f"rig says, others less: images were shifted to agree ({found.reason}); "
            f"{self._advice('calibrate again')}",
            *doubt,
        ]

    def _advice(self, usual: str) -> str:
        """Return what to do about cameras that seem wrong: they may only seem so."""
        if not self.unmodelled_light:
            return usual
        return f"see to the light that no volume explains first, and if this stays, {usual}"

    def report(self, pixels_used: int) -> dict[str, Any]:
        """Return what was left out, and why, for the report."""
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
            if scan.shrink > 1:
                size = scan.recorded_sizes[camera.name]
                own = replace(own.scaled(scan.shrink), image_size=size)
            cameras.append(own)
        known = {**(scan.rig.calibration or {}), **found}
        return replace(scan.rig, cameras=tuple(cameras), calibration=known)


def prepare(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    align: bool,
    carving: dict[str, Any] | None,
    refining: dict[str, Any] | None = None,
    noise: Sequence[NoiseModel] | None = None,
    unmodelled_light: bool = False,
) -> Prepared:
    """Align and refine the cameras and carve the volume, from the images alone.

    Parameters
    ----------
    rig, images, masks, grid
        Of the cameras to reconstruct from.
    align : bool
        Whether to look for shifts of the cameras' images.
    carving : dict, optional
        Settings of `tomo.hull.carve`; nothing is carved when None.
    refining : dict, optional
        Settings of `tomo.selfcal.refine.refine_cameras`; nothing is refined when None.
    noise : sequence of NoiseModel, optional
        Of each image, where it is known already.
    unmodelled_light : bool
        See `Prepared`.
    """
    if refining is not None and set(refining["cameras"]) >= set(rig.names):
        align = False  # what a shift would do is done better
    alignment = align_views(rig, images, grid, masks=masks) if align else None
    if alignment is not None:
        rig = alignment.rig(rig)
    refinement = None
    if refining is not None:  # of the shifted images: cameras that are not to move are in place
        skip = carving is not None
        refinement = refine_cameras(rig, images, grid, masks=masks, skip=skip, **refining)
        rig = refinement.rig
    if carving is None:
        active = ActiveVoxels(grid)
        return Prepared(rig, masks, active, alignment, None, refinement, unmodelled_light)
    found = carve(tuple(rig), images, masks, grid, noise=noise, **carving)
    return Prepared(
        rig, found.pixels, found.active, alignment, found, refinement, unmodelled_light
    )
