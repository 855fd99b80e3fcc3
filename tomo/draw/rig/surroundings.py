"""What stands in a rig's scene: solids, the lines of sight that they bend, calibration targets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from rigs import scene as optics
from tomo.draw import shapes
from tomo.draw.scene import Colour, Label, Mesh, Scene, as_colour, rgb

if TYPE_CHECKING:
    import trimesh

    from rigs.calibrate import Calibration

_GOOD, _BAD = rgb("#12826a"), rgb("#c2500f")

_LOOKS = {
    optics.Glass: (rgb("#6aa9c9"), 0.28),
    optics.Reflecting: (rgb("#8d99a6"), 0.75),
    optics.Opaque: (rgb("#4a4f57"), 1.0),
}
"""Colour and opacity of materials."""


def target_scene(rig: Rig) -> Scene:
    """Return the calibration targets as they were held, where the rig's calibration holds them.

    Reads ``calibration.target_poses``: a list of mappings with ``frame`` and ``corners``, the
    corners of the target in order, ``(N, 3)`` in the axes of ``camera``. Those of a camera that
    the rig has no more are left out, and all where the rig counts in another unit by now.
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


def solids_scene(scene: optics.Scene, radius: float, typical: float) -> Scene:
    """Return the solids of a scene; group ``solids``.

    ``radius`` is the target's, ``typical`` the distance of the cameras from it: endless plates are
    drawn around their point, wider than the target.
    """
    meshes = []
    for solid in scene.solids:
        colour, opacity = _LOOKS[type(solid.material)]
        width = min(2 * radius + 0.2 * typical, typical)
        meshes.append(Mesh(solid.name, "solids", *triangles_of(solid, width), colour, opacity))
    return Scene(tuple(meshes))


def triangles_of(solid: optics.Solid, width: float) -> tuple[NDArray[np.float64], NDArray]:
    """Return vertices ``(V, 3)`` and triangles of a solid; ``width`` is for one without end."""
    import trimesh

    if isinstance(solid, optics.Mesh):
        return solid.vertices, solid.triangles
    if isinstance(solid, optics.Sphere):
        ball = trimesh.creation.icosphere(radius=solid.radius)
        return ball.vertices + np.array(solid.center), ball.faces
    if isinstance(solid, optics.Cylinder):
        length = solid.length if math.isfinite(solid.length) else width
        across = np.array(solid.axis)
        if solid.inner_radius > 0:
            made = trimesh.creation.annulus(solid.inner_radius, solid.radius, length)
        else:
            made = trimesh.creation.cylinder(solid.radius, length)
        return _placed(made, np.array(solid.point), across, None)
    if not isinstance(solid, optics.Window | optics.Mirror):
        raise ValueError(
            f"scene: solid {solid.name}: found {type(solid).__name__}, expected a Window, "
            "Cylinder, Sphere, Mirror or Mesh to draw"
        )
    thickness = solid.thickness if isinstance(solid, optics.Window) else 1e-3 * width
    size = width if solid.size is None else solid.size
    if isinstance(size, tuple):
        made = trimesh.creation.box((*size, thickness))
    else:
        made = trimesh.creation.cylinder(size / 2, thickness)
    normal = np.array(solid.normal)
    return _placed(made, np.array(solid.point) - thickness / 2 * normal, normal, solid.across)


def _placed(
    made: trimesh.Trimesh, middle: NDArray, axis: NDArray, across: tuple | None
) -> tuple[NDArray[np.float64], NDArray]:
    """Return a shape made along z, with its axis and its first side turned to those given."""
    from rigs.scene.surfaces import perpendicular

    first = perpendicular(axis) if across is None else np.array(across)
    turn = np.stack([first, np.cross(axis, first), axis])
    return made.vertices @ turn + middle, made.faces


def bent_line(
    camera: optics.SceneCamera, center: NDArray[np.float64], radius: float
) -> NDArray[np.float64]:
    """Return the corners of the path of a pixel, from the camera up to the target: ``(N, 3)``.

    The pixel is the one that sees the target's middle; where none does, the image's middle. The
    line ends 2.2 radii before the middle.
    """
    uv, _, valid = camera.project(center[None])
    if not valid[0]:
        uv = (np.array([camera.image_size]) - 1.0) / 2
    paths, pixels = camera.paths(uv)
    if not len(pixels):
        return np.array([camera.camera.position, center])
    last = int(paths.nearest_pieces(center)[0])
    origin, direction = paths.origins[last], paths.directions[last]
    end = min(max(float((center - origin) @ direction) - 2.2 * radius, 0.0), paths.lengths[last])
    return np.vstack([paths.origins[: last + 1], origin + end * direction])
