"""What is settled before anything is traced: where the cameras look, and what is surely empty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.alignment import Alignment, align_views
from tomo.grid import VoxelGrid
from tomo.live_voxels import LiveVoxels
from tomo.support import Carving, carve


@dataclass(frozen=True, eq=False)
class Prepared:
    """The rig, pixels and voxels to trace.

    Attributes
    ----------
    rig : Rig
        The cameras, shifted where that was found worth it.
    masks : sequence of (height, width) bool
        True where a pixel may take part.
    live : LiveVoxels
        The voxels that may be other than zero.
    alignment, carving : optional
        How they were found; None where it was not asked for.
    """

    rig: Rig
    masks: Sequence[NDArray[np.bool_]]
    live: LiveVoxels
    alignment: Alignment | None = None
    carving: Carving | None = None

    @property
    def warnings(self) -> list[str]:
        """What the user should know of it."""
        if self.alignment is None or not self.alignment.accepted:
            return []
        lengths = np.linalg.norm(self.alignment.shifts, axis=1)
        worst = int(np.argmax(lengths))
        return [
            f"camera {self.rig.names[worst]} looks {lengths[worst]:.1f} pixels beside where the "
            f"rig says, others less: images were shifted to agree ({self.alignment.reason}); "
            "calibrate again"
        ]

    def report(self, pixels_used: int) -> dict[str, Any]:
        """Return what was left out, and why, for the report."""
        recorded = sum(math.prod(camera.image_size) for camera in self.rig)
        counts = {"pixels_recorded": recorded, "pixels_used": pixels_used}
        return counts if self.carving is None else {**counts, **self.carving.report()}


def prepare(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    align: bool,
    carving: dict[str, Any] | None,
) -> Prepared:
    """Align the cameras and carve the volume, from the images alone.

    Parameters
    ----------
    rig, images, masks, grid
        Of the cameras to reconstruct from.
    align : bool
        Whether to look for shifts of the cameras' images.
    carving : dict, optional
        Settings of `tomo.support.carve`; nothing is carved when None.
    """
    alignment = align_views(rig, images, grid, masks=masks) if align else None
    if alignment is not None:
        rig = alignment.rig(rig)
    if carving is None:
        return Prepared(rig, masks, LiveVoxels(grid), alignment)
    found = carve(tuple(rig), images, masks, grid, **carving)
    return Prepared(rig, found.pixels, found.live, alignment, found)
