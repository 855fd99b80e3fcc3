"""Calibration targets as they were held, in the scene of a rig."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.draw import shapes
from tomo.draw.scene import Colour, Label, Mesh, Scene, as_colour, rgb

if TYPE_CHECKING:
    from rigs.calibrate import Calibration

_GOOD, _BAD = rgb("#12826a"), rgb("#c2500f")


def target_scene(rig: Rig) -> Scene:
    """Return the calibration targets as they were held, where the rig's calibration holds them.

    Reads ``calibration.target_poses``: a list of mappings with ``frame`` and ``corners``, the
    corners of the target in order, ``(N, 3)`` in the axes of ``camera``. Those of a camera that
    the rig has no more are left out, and all where the rig counts in another unit by now.
    Groups: ``targets, target names``.

    Raises
    ------
    ValueError
        If they are none of that.
    """
    scene = Scene(length_unit=rig.length_unit)
    summary = rig.calibration or {}
    is_same_unit = summary.get("length_unit", rig.length_unit) == rig.length_unit
    poses = (summary.get("target_poses") if is_same_unit else None) or []
    if not isinstance(poses, list | tuple):
        raise ValueError(f"calibration.target_poses: found {str(poses)[:60]!r}, expected a list")
    for index, pose in enumerate(poses):
        name, camera, border = _pose(pose, f"calibration.target_poses[{index}]")
        if camera in rig:
            scene += _held(name, (border - rig[camera].t) @ rig[camera].R, _GOOD)
    return scene


def calibration_targets(calibration: Calibration) -> Scene:
    """Return the target as it was held in every frame of a calibration; the group is ``targets``.

    Colours run from green for the frame of least RMS residual to orange for that of the largest.
    """
    scene = Scene(length_unit=calibration.rig.length_unit)
    observations, rms = calibration.observations, calibration.quality.frame_rms
    points = observations.target_points
    (x0, y0), (x1, y1) = points.min(axis=0)[:2], points.max(axis=0)[:2]
    corners = np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])
    low, high = np.nanmin(rms), np.nanmax(rms)
    for frame in np.flatnonzero(np.isfinite(calibration.target_t).all(axis=1)):
        part = (rms[frame] - low) / (high - low) if high > low else 0.0
        part = float(part) if np.isfinite(part) else 1.0
        colour = as_colour(a + (b - a) * part for a, b in zip(_GOOD, _BAD, strict=True))
        border = corners @ calibration.target_R[frame].T + calibration.target_t[frame]
        name = f"{observations.frames[frame]}: RMS {rms[frame]:.3g} px"
        scene += _held(name, border, colour).only(["targets"])
    return scene


def _held(name: str, border: NDArray[np.float64], colour: Colour) -> Scene:
    """Return one target with the corners ``border`` ``(N, 3)``."""
    size = float(np.linalg.norm(np.ptp(border, axis=0)))
    middle = border.mean(axis=0)
    outline = shapes.polyline(border, 0.004 * size, closed=True)
    meshes = (
        Mesh(name, "targets", *outline, colour),
        Mesh(name, "targets", *shapes.fan(middle, border), colour, 0.12),
    )
    label = Label(name, "target names", border[0], 0.1 * (border[0] - middle), colour)
    return Scene(meshes, (label,))


def _pose(pose: object, what: str) -> tuple[str, str, NDArray[np.float64]]:
    """Return the names of frame and camera, and the corners ``(N, 3)`` of one target."""
    name, camera, border = "", "", np.zeros((0, 3))
    if isinstance(pose, Mapping):
        with suppress(TypeError, ValueError, KeyError):
            name, camera, border = (
                str(pose["frame"]),
                str(pose["camera"]),
                np.array(pose["corners"], np.float64),
            )
    is_outline = border.ndim == 2 and len(border) > 2 and border.shape[1] == 3
    if not (is_outline and np.isfinite(border).all()):
        raise ValueError(
            f"{what}: found {str(pose)[:60]!r}, expected frame, camera and corners (N, 3)"
        )
    return name, camera, border
