"""The kinds of files that hold rigs, and pictures of them."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from _stress.machine_kind import Kind, versions

if TYPE_CHECKING:
    from rigs import Rig
    from tomo.draw import Scene


def rig() -> Kind:
    """Write a ``rig.yaml``."""
    from rigs import load_rig, save_rig

    def write(folder: Path, _: None, version: int) -> None:
        save_rig(rig_of(24, version), folder / "rig.yaml")

    def read(folder: Path) -> set[int]:
        rig = load_rig(folder / "rig.yaml")
        return versions_of(rig)

    return Kind(write, read)


def rig_of(views: int, version: int) -> Rig:
    """Return a rig whose cameras' distance tells the version."""
    from rigs import ring

    return ring(views, distance=100.0 + version, image_size=(80, 60), footprint=0.5)


def versions_of(rig: Rig) -> set[int]:
    """Return the versions of a rig's cameras."""
    return {round(float(np.linalg.norm(camera.position))) - 100 for camera in rig}


def model() -> Kind:
    """Write a model of COLMAP: several files, whose cameras' lenses tell the version too."""
    from rigs.formats import colmap

    def write(folder: Path, _: None, version: int) -> None:
        colmap.save(rig_of(24, version), folder)

    def read(folder: Path) -> set[int]:
        if not (folder / "cameras.txt").exists():
            return set()
        rig = colmap.load(folder)
        lenses = {round(0.5 * camera.camera_matrix[0, 0]) - 100 for camera in rig}
        return lenses | versions_of(rig)

    return Kind(write, read, tells=True)


def ray_table() -> Kind:
    """Write a table of rays, all from the place that tells the version."""
    from rigs import RayTable
    from rigs.ray_table.ray_file import load_ray_table, save_ray_table

    looking = np.broadcast_to([0.0, 0.0, 1.0], (480, 640, 3))

    def write(folder: Path, _: None, version: int) -> None:
        save_ray_table(RayTable("camera", [version, 0, 0], looking), folder / "rays.npz")

    def read(folder: Path) -> set[int]:
        return versions(load_ray_table("camera", "rays.npz", folder).own_origins[..., 0])

    return Kind(write, read)


def page() -> Kind:
    """Write a page to turn a rig on; its title tells the version."""
    import plotly.graph_objects  # noqa: F401  before there are forks

    from tomo.draw import write_html

    def write(folder: Path, scene: Scene, version: int) -> None:
        write_html(folder / "page.html", scene, title=f"version {version}")

    def read(folder: Path) -> set[int]:
        text = (folder / "page.html").read_text("utf-8")
        named = set(map(int, re.findall(r"<title>version (\d+)", text)))
        return named if text.rstrip().endswith("</html>") else {-1}

    return Kind(write, read, _scene)


def meshes() -> Kind:
    """Write a rig's meshes, whose names tell the version."""
    import trimesh  # noqa: F401  before there are forks

    from tomo.draw import write_glb

    def write(folder: Path, scene: Scene, version: int) -> None:
        named = [replace(mesh, group=f"version {version}") for mesh in scene.meshes]
        write_glb(folder / "scene.glb", replace(scene, meshes=tuple(named)))

    def read(folder: Path) -> set[int]:
        data = (folder / "scene.glb").read_bytes()
        (length,) = struct.unpack("<I", data[8:12])
        named = set(map(int, re.findall(rb"version (\d+)", data)))
        return named if length == len(data) else {-1}

    return Kind(write, read, _scene)


def _scene() -> Scene:
    from tomo.draw.rig import rig_scene

    return rig_scene(rig_of(6, 1)).without("stems")
