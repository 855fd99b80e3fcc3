"""Schema of rig.yaml: names and types of fields; geometry is checked by Camera and Rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

import pydantic

from rigs.files.messages import dotted, first_problem


def _number(value: object) -> float:
    """Return a finite float; text like ``1e-5``, which YAML 1.1 reads as text, is accepted."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError("a number")
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise ValueError("a number") from None
    if not math.isfinite(number):
        raise ValueError("a finite number")
    return number


def _whole(value: object) -> int:
    """Return a whole number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value // 1:
        raise ValueError("a whole number")
    if abs(value) >= 2**63:
        raise ValueError("a whole number of 64 bits")
    return int(value)


def _text(value: object) -> str:
    """Return text; a bare number is an error, because ``01`` and ``1`` are the same number."""
    if not isinstance(value, str):
        raise ValueError("text (put it in quotes)")
    return value


Number = Annotated[float, pydantic.BeforeValidator(_number)]
Whole = Annotated[int, pydantic.BeforeValidator(_whole)]
Text = Annotated[str, pydantic.BeforeValidator(_text)]
Vector = tuple[Number, Number, Number]
Matrix = tuple[Vector, Vector, Vector]


class _Entry(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", protected_namespaces=())


class DistortionEntry(_Entry):
    """``distortion:`` of a camera."""

    model: Text
    coefficients: list[Number] = []


class OpticsEntry(_Entry):
    """``optics:`` of a camera."""

    focal_length: Number | None = None
    f_number: Number | None = None
    focus_distance: Number | None = None
    pixel_pitch: Number | None = None


class AccuracyEntry(_Entry):
    """``accuracy:`` of a camera."""

    shift: Number | None = None
    roll: Number | None = None
    magnification: Number | None = None
    direction: Number | None = None


class CameraEntry(_Entry):
    """One of ``cameras:``, with all alternatives for intrinsics and pose."""

    name: Text
    ray_table: Text | None = None
    image_size: tuple[Whole, Whole] | None = None
    camera_matrix: Matrix | None = None
    focal_length: Number | None = None
    pixel_pitch: Number | tuple[Number, Number] | None = None
    principal_point: tuple[Number, Number] | None = None
    distortion: DistortionEntry = DistortionEntry(model="none")
    R: Matrix | None = None
    t: Vector | None = None
    position: Vector | None = None
    look_at: Vector | None = None
    up: Vector | None = None
    optics: OpticsEntry | None = None
    status: Text = "nominal"
    accuracy: AccuracyEntry | None = None


class VolumeEntry(_Entry):
    """``volume:`` of a rig."""

    shape: tuple[Whole, Whole, Whole]
    spacing: Number | Vector
    center: Vector = (0.0, 0.0, 0.0)


class SolidEntry(_Entry):
    """One of a scene's ``solids:``, with the fields of all types; see `rigs.scene.entry`."""

    name: Text
    type: Text
    material: Text | None = None
    index: Number | Text | None = None
    extinction: Number | None = None
    reflectivity: Number | None = None
    point: Vector | None = None
    normal: Vector | None = None
    axis: Vector | None = None
    across: Vector | None = None
    center: Vector | None = None
    radius: Number | None = None
    inner_radius: Number | None = None
    length: Number | None = None
    thickness: Number | None = None
    size: Number | tuple[Number, Number] | None = None
    beyond: Number | Text | None = None
    inside: Number | Text | None = None
    file: Text | None = None
    unit: Text | None = None
    R: Matrix | None = None
    t: Vector | None = None
    smooth: bool = False


class GasEntry(_Entry):
    """``gas:`` of a scene: files of voxels."""

    index: Text | None = None
    extinction: Text | None = None


class SceneEntry(_Entry):
    """``scene:`` of a rig: what stands in the light's way."""

    medium: Number | Text = 1.0
    fresnel: bool = False
    solids: list[SolidEntry] = []
    gas: GasEntry | None = None


class RigEntry(_Entry):
    """The whole file."""

    format: Text
    version: Whole
    length_unit: Text = "mm"
    convention: Text = "opencv"
    world_frame: Text = ""
    cameras: list[CameraEntry]
    volume: VolumeEntry | None = None
    scene: SceneEntry | None = None
    calibration: dict[str, Any] | None = None


def parse_rig(data: Mapping[str, Any]) -> RigEntry:
    """Return the checked entries of a rig file."""
    try:
        return RigEntry.model_validate(data)
    except pydantic.ValidationError as error:
        path, message = first_problem(error, RigEntry, data)
        raise ValueError(f"{_where(path, data)}: {message}") from None


def _where(path: list[str | int], data: Mapping[str, Any]) -> str:
    """Return the camera, by name where it has one, and the field."""
    if path[0] == "cameras" and len(path) > 2:
        entry = data["cameras"][path[1]]
        if isinstance(entry.get("name"), str):
            return f"camera {entry['name']}: {dotted(path[2:])}"
        return f"{dotted(path[:2])}: {dotted(path[2:])}"
    if path[:2] == ["scene", "solids"] and len(path) > 3:
        entry = data["scene"]["solids"][path[2]]
        if isinstance(entry.get("name"), str):
            return f"scene: solid {entry['name']}: {dotted(path[3:])}"
    return dotted(path)
