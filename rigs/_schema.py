"""What may stand in a rig.yaml: types and names only; geometry is checked by Camera and Rig."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from typing import Annotated, Any

import pydantic

from rigs._text import shortened


def _number(value: object) -> float:
    """Return a finite float; text like ``1e-5``, which YAML 1.1 takes for text, counts too."""
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
    return int(value)


def _text(value: object) -> str:
    """Return text; a bare number is an error, because ``01`` and ``1`` would be the same."""
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


class CameraEntry(_Entry):
    """One of ``cameras:``, with all ways to give the intrinsics and the pose."""

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


class VolumeEntry(_Entry):
    """``volume:`` of a rig."""

    shape: tuple[Whole, Whole, Whole]
    spacing: Number | Vector
    center: Vector = (0.0, 0.0, 0.0)


class RigEntry(_Entry):
    """The whole file."""

    format: Text
    version: Whole
    length_unit: Text = "mm"
    convention: Text = "opencv"
    world_frame: Text = ""
    cameras: list[CameraEntry]
    volume: VolumeEntry | None = None
    calibration: dict[str, Any] | None = None


_SECTIONS: dict[str, type[_Entry]] = {
    "cameras": CameraEntry,
    "distortion": DistortionEntry,
    "optics": OpticsEntry,
    "volume": VolumeEntry,
}


def parse_rig(data: Mapping[str, Any]) -> RigEntry:
    """Return the checked entries of a rig file.

    Raises
    ------
    ValueError
        In one line: the camera, the field, what was found and what was expected.
    """
    try:
        return RigEntry.model_validate(data)
    except pydantic.ValidationError as error:
        # Of several errors the most specific one is told: unknown fields before missing ones.
        errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        raise ValueError(_one_line(errors[0], data)) from None


def _one_line(error: Mapping[str, Any], data: Mapping[str, Any]) -> str:
    """Return pydantic's error in the words of the file."""
    path = [part for part in error["loc"] if not _is_union_branch(part)]
    camera, field = "", path
    if path[0] == "cameras" and len(path) > 1:
        entry = data["cameras"][path[1]]
        name = entry.get("name") if isinstance(entry, dict) else None
        camera = f"camera {name if isinstance(name, str) else f'number {path[1]}'}: "
        field = path[2:] or ["entry"]
    where = camera + _dotted(field)
    if error["type"] == "extra_forbidden":
        parents = [part for part in path[:-1] if isinstance(part, str)]
        known = list(_SECTIONS[parents[-1]].model_fields if parents else RigEntry.model_fields)
        near = difflib.get_close_matches(str(path[-1]), known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(known)}"
        return f"{where}: unknown field, {hint}"
    if error["type"] == "missing":
        # pydantic reports a tuple that is too short as an item that is missing
        if isinstance(path[-1], int):
            return f"{camera}{_dotted(field[:-1])}: found {path[-1]} values, expected more"
        return f"{where}: missing"
    if error["type"] == "value_error":
        expected = str(error["ctx"]["error"])
    elif error["type"] in ("tuple_type", "list_type"):
        expected = "a list"
    elif error["type"] in ("model_type", "dict_type"):
        expected = "a mapping"
    else:
        expected = " ".join(error["msg"].split())
    return f"{where}: found {shortened(error['input'])}, expected {expected}"


def _is_union_branch(part: str | int) -> bool:
    """Say whether a step of pydantic's path names a type that was tried, not a field."""
    return isinstance(part, str) and ("[" in part or part in ("float", "tuple"))


def _dotted(path: list[str | int]) -> str:
    """Return ``distortion.coefficients[3]`` of its steps."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return " ".join(text.split())
