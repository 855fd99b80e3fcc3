"""Write a scene as an HTML page that works without a network, or as GLB for other programs."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import write_bytes, write_text
from tomo.draw.page import render, script_safe
from tomo.draw.rig.camera_view import CameraView
from tomo.draw.scene import Mesh, Scene
from tomo.draw.stage import stage
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    import trimesh
    from trimesh.visual import ColorVisuals, TextureVisuals

_METRES = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6}


@dataclass(frozen=True)
class Table:
    """A table of texts and numbers next to the scene."""

    title: str
    lines: tuple[tuple[str, str], ...]  # a kind (fault, warning, note or "") and a text each
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_html(
    path: str | os.PathLike,
    scene: Scene,
    *,
    title: str = "",
    views: Sequence[CameraView] = (),
    tables: Sequence[Table] = (),
    grid: VoxelGrid | None = None,
    **shown: Any,
) -> None:
    """Write the page: every group is a layer to switch on and off, the pointer shows names.

    Parameters
    ----------
    views : sequence of CameraView
        Adds a panel of their pictures; a pixel clicked there shows its ray.
    tables : sequence of Table
        Below the scene.
    grid : VoxelGrid, optional
        Adds buttons that show the whole scene or the box alone.
    shown
        Further arguments of `stage`.
    """
    box = None if grid is None else [grid.lower.tolist(), grid.upper.tolist()]
    seen = json.dumps({"views": [view.data() for view in views], "box": box}) if views else ""
    one = stage(scene.without("stems"), grid=grid, rays=bool(views), **shown)
    write_page(path, one, title=title, tables=tables, views=script_safe(seen))


def write_page(
    path: str | os.PathLike,
    stage: Mapping[str, Any],
    *,
    title: str = "",
    tables: Sequence[Table] = (),
    views: str = "",
) -> None:
    """Write the page of a `stage`; ``views`` is the JSON of the panel of cameras, if any."""
    text = render("scene.html", title=title or "Scene", stage=stage, tables=tables, views=views)
    write_text(path, text)


def write_glb(path: str | os.PathLike, scene: Scene) -> None:
    """Write the meshes but for plumb lines, one node each, named ``group/name``.

    glTF uses metres. Every node carries the scale from the scene's length unit, so that a
    rig given in millimetres has its true size. Axes are the world's own.

    Raises
    ------
    ValueError
        If there is nothing to write.
    """
    import trimesh

    scene = scene.without("stems")
    scale = np.diag([*[_METRES.get(scene.length_unit.strip(), 1.0)] * 3, 1.0])
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
    write_bytes(path, written.export(file_type="glb", include_normals=True))


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
