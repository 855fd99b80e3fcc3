"""The geometry of a calibration: the rig, and where the target was held."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import shapes
from tomo.draw.rig.rig_scene import rig_scene
from tomo.draw.scene import Colour, Mesh, Scene, as_colour, rgb
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from rigs.calibrate import Calibration

_GOOD, _BAD = rgb("#12826a"), rgb("#c2500f")


def calibration_scene(calibration: Calibration, grid: VoxelGrid | None = None) -> Scene:
    """Return the scene of `rig_scene` with the target as it was held in every frame.

    The group ``targets`` comes to those of `rig_scene`. Colours run from green for the frame of
    least RMS residual to orange for that of the largest.
    """
    rig = calibration.rig
    scene = rig_scene(rig, grid)
    posed = np.flatnonzero(np.isfinite(calibration.target_t).all(axis=1))
    rms = calibration.quality.frame_rms
    seen = rms[posed][np.isfinite(rms[posed])]
    low, high = (seen.min(), seen.max()) if len(seen) else (0.0, 1.0)
    corners = _outline(calibration.observations.target_points)
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    meshes = []
    for frame in posed:
        name = calibration.observations.frames[frame]
        R, t = calibration.target_R[frame], calibration.target_t[frame]
        border = corners @ R.T + t
        fraction = (rms[frame] - low) / (high - low) if high > low else 0.0
        colour = _between(fraction if np.isfinite(fraction) else 1.0)
        words = f"{name}: RMS {rms[frame]:.3g} px"
        outline = shapes.polyline(border, 0.004 * size, closed=True)
        meshes += [
            Mesh(words, "targets", *outline, colour),
            Mesh(words, "targets", *shapes.fan(border.mean(axis=0), border), colour, 0.12),
        ]
    return scene + Scene(tuple(meshes), (), rig.length_unit)


def _outline(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners, in order, of the smallest rectangle along x and y round the points."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.array([[low[0], low[1]], [high[0], low[1]], high[:2], [low[0], high[1]]]) @ np.eye(
        2, 3
    )


def _between(fraction: float) -> Colour:
    return as_colour(a + (b - a) * float(fraction) for a, b in zip(_GOOD, _BAD, strict=True))
