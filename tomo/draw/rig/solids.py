"""Solids of a rig's scene, and lines of sight that they bend."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import scene as optics
from tomo.draw.scene import Mesh, Scene, rgb

if TYPE_CHECKING:
    import trimesh

_LOOKS = {
    optics.Glass: (rgb("#6aa9c9"), 0.28),
    optics.Reflecting: (rgb("#8d99a6"), 0.75),
    optics.Opaque: (rgb("#4a4f57"), 1.0),
}
"""Colour and opacity of materials."""

_SECTIONS = 48  # sides of a drawn cylinder


def solids_scene(scene: optics.Scene, radius: float, typical: float) -> Scene:
    """Return the solids of a scene; group ``solids``.

    Parameters
    ----------
    scene : rigs.scene.Scene
    radius : float
        Of the target: endless plates are drawn around their point, wider than it.
    typical : float
        Typical distance of the cameras from the target.
    """
    meshes = []
    for solid in scene.solids:
        colour, opacity = _LOOKS[type(solid.material)]
        width = min(2 * radius + 0.2 * typical, typical)
        meshes.append(Mesh(solid.name, "solids", *triangles_of(solid, width), colour, opacity))
    return Scene(tuple(meshes))


def triangles_of(solid: optics.Solid, width: float) -> tuple[NDArray[np.float64], NDArray]:
    """Return vertices ``(V, 3)`` and triangles ``(T, 3)`` of a solid.

    Parameters
    ----------
    solid : Solid
    width : float
        Drawn extent of one that has no end.
    """
    import trimesh

    if isinstance(solid, optics.Mesh):
        return solid.vertices, solid.triangles
    if isinstance(solid, optics.Sphere):
        ball = trimesh.creation.icosphere(subdivisions=3, radius=solid.radius)
        return ball.vertices + np.array(solid.center), ball.faces
    if isinstance(solid, optics.Cylinder):
        length = solid.length if math.isfinite(solid.length) else width
        across = np.array(solid.axis)
        if solid.inner_radius > 0:
            made = trimesh.creation.annulus(
                solid.inner_radius, solid.radius, height=length, sections=_SECTIONS
            )
        else:
            made = trimesh.creation.cylinder(solid.radius, height=length, sections=_SECTIONS)
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
        made = trimesh.creation.cylinder(size / 2, thickness, sections=_SECTIONS)
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

    The pixel is the one that sees the target's middle; where none does, the image's middle.

    Parameters
    ----------
    camera : SceneCamera
    center, radius : (3,) float64, float
        Of the target; the line ends 2.2 radii before the middle.
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
