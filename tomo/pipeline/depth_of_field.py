"""The report's words on depth of field: how wide the lenses' blur is across the grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from rigs import CameraLike, Rig
from rigs.aperture import Aperture
from tomo.grid import VoxelGrid
from tomo.pipeline.options import Options
from tomo.rays.pixel_rays import rays_of_pixel

ENDS = ("near", "far")


def depth_of_field(rig: Rig, grid: VoxelGrid, options: Options) -> dict[str, Any] | None:
    """Return how depth of field was modelled; None where lenses were pinholes.

    Returns
    -------
    dict
        ``in_words``; ``rays``, of a pixel; ``near`` and ``far``, each with the diameter of the
        circle of confusion at that end of the grid by camera, in the rig's length unit, and
        ``near_pixels`` and ``far_pixels``.
    """
    if options.aperture_rays == 1:
        return None
    rays = rays_of_pixel(**options.rays)
    found: dict[str, Any] = {"in_words": "", "rays": rays}
    blurs = {camera.name: _blur_at_ends(camera, grid) for camera in rig}
    for number, end in enumerate(ENDS):
        found[end] = {name: blur[0][number] for name, blur in blurs.items()}
        found[f"{end}_pixels"] = {name: blur[1][number] for name, blur in blurs.items()}
    widest = (
        f"up to {max(found[end].values()):.3g} {rig.length_unit} "
        f"({max(found[f'{end}_pixels'].values()):.1f} pixels) at the {end} end"
        for end in ENDS
    )
    found["in_words"] = (
        f"depth of field was modelled by {rays} rays a pixel over the lenses' apertures; their "
        f"blur discs are {' and '.join(widest)} of the grid"
    )
    return found


def _blur_at_ends(camera: CameraLike, grid: VoxelGrid) -> tuple[list[float], list[float]]:
    """Return the blur at the grid's near and far end: in lengths, and in pixels."""
    corners = np.stack(np.meshgrid(*zip(grid.lower, grid.upper, strict=True)), -1).reshape(-1, 3)
    depths = corners @ camera.R[2] + camera.t[2]
    ends = np.maximum([depths.min(), depths.max()], min(grid.spacing))  # ahead of the camera
    blur = Aperture.of(camera).blur(ends)
    return blur.tolist(), (camera.camera_matrix[0, 0] * blur / ends).tolist()
