"""Write a scene as GLB, for viewers and modelling programs."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.draw.scene import Mesh, Scene

if TYPE_CHECKING:
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

_METRES = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}


def metres_per(length_unit: str) -> float:
    """Return the metres in a length unit; 1 for an unknown unit."""
    return _METRES.get(length_unit.strip(), 1.0)


def write_glb(
    path: str | os.PathLike, scene: Scene, *, leave_out: tuple[str, ...] = ("stems",)
) -> None:
    """Write the scene's meshes, one node each, named ``group/name``.

    glTF uses metres. Every node carries the scale from the scene's length unit, so that a
    rig given in millimetres has its true size. Axes are the world's own.

    Parameters
    ----------
    path : path-like
    scene : Scene
    leave_out : tuple of str
        Groups not to write.

    Raises
    ------
    ValueError
        If there is nothing to write.
    """
    import trimesh

    scene = scene.without(*leave_out)
    scale = np.diag([*[metres_per(scene.length_unit)] * 3, 1.0])
    written = trimesh.Scene()
    for mesh in scene.meshes:
        if not len(mesh.triangles):
            continue
        geometry = trimesh.Trimesh(
            mesh.vertices,
            mesh.triangles,
            vertex_normals=mesh.normals(),
            visual=_looks(mesh),
            process=False,
        )
        name = _unused(f"{mesh.group}/{mesh.name}", written)
        written.add_geometry(geometry, node_name=name, geom_name=name, transform=scale)
    if not written.geometry:
        raise ValueError("scene: found no mesh, expected at least one to write")
    data = written.export(file_type="glb", include_normals=True)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def _looks(mesh: Mesh) -> ColorVisuals | TextureVisuals:
    """Return the mesh's colours as trimesh holds them: one material, or one colour a vertex."""
    import trimesh
    from trimesh.visual.material import PBRMaterial

    if mesh.vertex_colours is not None:
        colours = _linear(mesh.vertex_colours)
        alpha = np.full((len(colours), 1), mesh.opacity)
        levels = np.round(255 * np.hstack([colours, alpha])).astype(np.uint8)
        return trimesh.visual.ColorVisuals(vertex_colors=levels)
    material = PBRMaterial(
        name=mesh.group,
        baseColorFactor=[
            *np.round(255 * _linear(np.array(mesh.colour))).astype(int).tolist(),
            round(255 * mesh.opacity),
        ],
        metallicFactor=0.0,
        roughnessFactor=0.7,
        doubleSided=True,
        alphaMode="OPAQUE" if mesh.opacity >= 1 else "BLEND",
    )
    return trimesh.visual.TextureVisuals(material=material)


def _linear(values: NDArray) -> NDArray[np.float64]:
    """Return sRGB values in 0..1 as linear light, which glTF's colours are."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _unused(name: str, scene: trimesh.Scene) -> str:
    """Return ``name``, numbered if it is taken."""
    number, candidate = 2, name
    while candidate in scene.geometry:
        candidate, number = f"{name} {number}", number + 1
    return candidate
