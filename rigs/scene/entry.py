"""The ``scene:`` of a rig.yaml: reading it, and writing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from rigs.files.schema import SceneEntry, SolidEntry
from rigs.files.size_guard import path_inside
from rigs.files.units import metres
from rigs.geometry.rotation import numbers, rotation
from rigs.scene.gas import read_gas
from rigs.scene.materials import Glass, Material, Opaque, Reflecting, index_of
from rigs.scene.mesh import Mesh
from rigs.scene.mesh_file import read_mesh
from rigs.scene.plates import Mirror, Window
from rigs.scene.scene import Scene
from rigs.scene.solids import AnalyticSolid, Cylinder, Solid, Sphere

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


def scene_of(entry: SceneEntry, folder: Path, length_unit: str) -> Scene:
    """Return the scene of a checked entry.

    Parameters
    ----------
    entry : SceneEntry
    folder : Path
        Of the file: meshes are inside.
    length_unit : str
        The file's, in which meshes without a unit are.

    Raises
    ------
    FileNotFoundError
        If a mesh's file is missing.
    ValueError
        In one line: the solid, the field, what was found and what was expected.
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

    Parameters
    ----------
    scene : Scene
    mesh_name : callable
        Gives the name of the file that holds a mesh.
    gas_name : callable
        Gives that of the file that holds the gas's ``index`` or ``extinction``.

    Raises
    ------
    ValueError
        If a solid is of a type that the file does not know.
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
