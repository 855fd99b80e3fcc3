"""The ``scene:`` of a rig.yaml: reading and writing it and its meshes; whether it fits a rig."""

from __future__ import annotations

import io
import math
import os
import struct
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.schema import SceneEntry, SolidEntry
from rigs.files.size_guard import path_inside
from rigs.files.text import check_plain_file, write_bytes
from rigs.files.units import metres
from rigs.geometry.rotation import numbers, rotation
from rigs.scene.gas import read_gas
from rigs.scene.gas.gas import reaches_into
from rigs.scene.mesh import LARGEST, Mesh
from rigs.scene.plates import Mirror, Window
from rigs.scene.scene import Scene
from rigs.scene.solids import AnalyticSolid, Cylinder, Solid, Sphere
from rigs.scene.surfaces import Glass, Material, Opaque, Reflecting, index_of

if TYPE_CHECKING:
    from rigs.rig import Rig

TYPES: dict[str, type] = {
    "window": Window,
    "cylinder": Cylinder,
    "sphere": Sphere,
    "mirror": Mirror,
    "mesh": Mesh,
}
"""Types of solids by their name in the file; the fields are those of the classes."""

_MATERIALS = {"window": "glass", "mirror": "mirror"}  # where the type leaves no choice
_MESH_FIELDS = ("file", "unit", "R", "t", "smooth")
_MATERIAL_FIELDS = {"opaque": (), "mirror": ("reflectivity",), "glass": ("index", "extinction")}

UNLIKELY = 300
"""Ratio of the cameras' distance to the largest solid, either way, that a wrong unit explains:
mm for m is 1000, and a nozzle at a twentieth of the distance is a right one."""


def scene_of(entry: SceneEntry, folder: Path, length_unit: str) -> Scene:
    """Return the scene of a checked entry, whose meshes are inside ``folder``.

    Meshes that name no unit are in ``length_unit``. Errors name solid and field.
    """
    try:
        solids = tuple(_solid(solid, folder, length_unit) for solid in entry.solids)
        gas = None
        if entry.gas is not None:
            medium = index_of(entry.medium, "medium")
            files = entry.gas.model_dump()
            gas = read_gas(folder, length_unit, **files, medium=medium) or None
        return Scene(solids, entry.medium, entry.fresnel, gas)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith("scene: ") else f"scene: {text}") from None


def scene_data(
    scene: Scene, mesh_name: Callable[[Mesh], str], gas_name: Callable[[str], str]
) -> dict[str, Any]:
    """Return the plain data of a scene, in the order of the file.

    ``mesh_name`` names a mesh's file, ``gas_name`` that of the gas's ``index`` or ``extinction``.
    """
    solids = []
    for solid in scene.solids:
        kind = next((name for name, cls in TYPES.items() if type(solid) is cls), None)
        if kind is None:
            raise ValueError(
                f"scene: solid {solid.name}: found {type(solid).__name__}, expected one of "
                f"{', '.join(TYPES)} to write to a file"
            )
        data: dict[str, Any] = {"name": solid.name, "type": kind}
        if isinstance(solid, Mesh):
            data["file"] = mesh_name(solid)
            data |= {"smooth": True} if solid.smooth else {}
        elif isinstance(solid, AnalyticSolid):
            for field in fields(solid):
                value = getattr(solid, field.name)
                if field.name not in ("name", "material") and value not in (None, field.default):
                    data[field.name] = list(value) if isinstance(value, tuple) else value
        solids.append(data | _material_data(solid.material, kind))
    data = {"medium": scene.medium, "fresnel": scene.fresnel, "solids": solids}
    if scene.gas is None:
        return data
    names = [name for name in ("index", "extinction") if getattr(scene.gas, name) is not None]
    return data | {"gas": {name: gas_name(name) for name in names}}


def _solid(entry: SolidEntry, folder: Path, length_unit: str) -> Solid:
    """Return the solid of an entry."""
    what = f"solid {entry.name}"
    if entry.type not in TYPES:
        raise ValueError(f"{what}: type: found {entry.type!r}, expected one of {', '.join(TYPES)}")
    given = entry.model_fields_set - {"name", "type"}
    material, used = _material(entry, what)
    if entry.type == "mesh":
        own = set(_MESH_FIELDS)
        required = ["file"]
    else:
        every = [f for f in fields(TYPES[entry.type]) if f.name not in ("name", "material")]
        own = {field.name for field in every}
        required = [f.name for f in every if f.default is not None and f.name != "inner_radius"]
    for name in sorted(given - own - used):
        raise ValueError(f"{what}: {name}: found, expected no such field of a {entry.type}")
    for name in required:
        if getattr(entry, name) is None:
            raise ValueError(f"{what}: {name}: missing, expected for a {entry.type}")
    if entry.file is not None:  # a mesh's alone
        return _mesh(entry, entry.file, material, folder, length_unit)
    values = {name: getattr(entry, name) for name in own & given}
    return TYPES[entry.type](name=entry.name, material=material, **values)


def _material(entry: SolidEntry, what: str) -> tuple[Material, set[str]]:
    """Return the material of a solid, and the fields that belong to it."""
    only = _MATERIALS.get(entry.type)
    kind = entry.material or only
    if kind not in _MATERIAL_FIELDS or only not in (None, kind):
        expected = only or f"one of {', '.join(_MATERIAL_FIELDS)}"
        found = "missing" if kind is None else f"found {kind!r}"
        raise ValueError(f"{what}: material: {found}, expected {expected}")
    names = _MATERIAL_FIELDS[kind]
    values = {name: getattr(entry, name) for name in names if getattr(entry, name) is not None}
    if kind == "glass" and "index" not in values:
        raise ValueError(f"{what}: index: missing, expected the refractive index of the glass")
    try:
        found = {"opaque": Opaque, "mirror": Reflecting, "glass": Glass}[kind](**values)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
    return found, {"material", *names}


def _material_data(material: Material, kind: str) -> dict[str, Any]:
    """Return the fields that say what a solid is made of."""
    name = {Opaque: "opaque", Reflecting: "mirror", Glass: "glass"}[type(material)]
    data = {} if kind in _MATERIALS else {"material": name}
    for field in fields(material):
        value = getattr(material, field.name)
        if field.name == "index" or value != field.default:
            data[field.name] = value
    return data


def _mesh(
    entry: SolidEntry, file: str, material: Material, folder: Path, length_unit: str
) -> Mesh:
    """Return the solid of a mesh's file, in the rig's unit and at its place."""
    what = f"solid {entry.name}"
    path = path_inside(file, folder, f"{what}: file")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file, which scene: {what} has for file")
    try:
        vertices, triangles = read_mesh(path)
        factor = 1.0 if entry.unit is None else metres(entry.unit) / metres(length_unit)
        R = np.eye(3) if entry.R is None else rotation(entry.R, "R")
        t = np.zeros(3) if entry.t is None else numbers(entry.t, (3,), "t")
    except ValueError as error:
        raise ValueError(f"{what}: {file}: {error}") from None
    vertices = factor * vertices @ R.T + t
    return Mesh(entry.name, vertices, triangles, material, entry.smooth, file)


SUFFIXES = ("stl", "obj", "ply", "glb")


def read_mesh(path: str | os.PathLike) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the vertices ``(V, 3)`` and triangles ``(T, 3)`` of all parts in a file."""
    path = Path(path)
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in SUFFIXES:
        raise ValueError(f"found a .{suffix} file, expected one of {', '.join(SUFFIXES)}")
    check_plain_file(path)
    size = path.stat().st_size
    if size > LARGEST * 100:
        raise ValueError(
            f"found {size / 1e6:.0f} MB, expected at most {LARGEST * 100 / 1e6:.0f} MB: simplify "
            "the mesh"
        )
    import trimesh

    data = path.read_bytes()
    try:
        loaded = trimesh.load_mesh(
            io.BytesIO(data), file_type=suffix, process=False, maintain_order=True
        )
        vertices = np.array(loaded.vertices, np.float64)
        triangles = np.array(loaded.faces, np.int64).reshape(-1, 3)
    except (
        ValueError, LookupError, TypeError, AttributeError, EOFError, struct.error, MemoryError,
        ArithmeticError, NotImplementedError,
    ) as error:  # fmt: skip
        words = " ".join(str(error).split())[:80] or type(error).__name__
        raise ValueError(f"not a mesh: {words}") from None
    if not len(triangles):
        raise ValueError("found no triangle, expected a mesh of at least one")
    return vertices, triangles


def write_mesh(mesh: Mesh, path: str | os.PathLike) -> None:
    """Write a mesh as OBJ, with all digits of its coordinates."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.triangles + 1).tolist()]
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def check_scene(scene: Scene, rig: Rig) -> None:
    """Raise where glass reaches into the volume, or sizes differ as by a wrong unit.

    A camera in a solid is found by `rigs.scene.SceneCamera`.
    """
    if not scene.solids:
        return
    middle = np.zeros(3) if rig.volume is None else np.array(rig.volume.center)
    far = max(float(np.linalg.norm(camera.position - middle)) for camera in rig)
    size = max(
        (solid.diameter for solid in scene.solids if math.isfinite(solid.diameter)), default=far
    )
    if far > 0 and not far / UNLIKELY < size < far * UNLIKELY:
        raise ValueError(
            f"scene: found a largest solid of {size:.4g} {rig.length_unit} before cameras "
            f"{far:.4g} {rig.length_unit} away, expected like sizes: check the units of both "
            "(a mesh takes unit: m)"
        )
    if rig.volume is None:
        return
    corners = rig.volume.corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    for solid in scene.solids:
        # hardware may stand in the flame
        if isinstance(solid.material, Glass) and reaches_into(solid, low, high):
            raise ValueError(
                f"scene: solid {solid.name}: reaches into the volume from {low.round(4)} to "
                f"{high.round(4)}, expected glass outside: move it, or make the volume smaller"
            )
