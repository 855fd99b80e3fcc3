"""A table of cameras, as a spreadsheet saves it: where each stands, where it looks, its lens.

Read only. A line a camera, under a head of names in any order::

    name, x, y, z, look_x, look_y, look_z, focal_mm, pitch_um, width, height

Columns are parted by commas, semicolons (numbers may then have decimal commas) or tabs. A unit
stands behind a name: ``x_mm``, ``x (mm)`` or ``x [mm]``; places share one. ``focal`` is from the
pinhole to the sensor, ``pitch`` the distance of neighbouring pixels; ``focal_pixels`` is in place
of both. ``up_x, up_y, up_z`` point to the image's top, else y does, and a warning says so. Without
``width, height`` sizes are those asked for. The image's middle is the principal point; lenses have
no distortion, and cameras the status nominal.
"""

from __future__ import annotations

import csv
import logging
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from rigs.camera import Camera, look_at, pinhole_matrix
from rigs.files.text import read_text
from rigs.files.units import UNITS, UNKNOWN, metres
from rigs.formats._values import as_number, as_size, errors_of, required_size
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_ENDINGS = (".csv", ".tsv", ".txt")
_PLACE = ("x", "y", "z")
_LOOK = ("look_x", "look_y", "look_z")
_UP = ("up_x", "up_y", "up_z")
_COLUMNS = ("name", *_PLACE, *_LOOK, *_UP, "focal", "pitch", "width", "height")
_PIXELS = "pixels"


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file's first line names the columns of cameras and their places."""
    first = head.lstrip().partition("\n")[0]
    return path.suffix.lower() in _ENDINGS and {"name", *_PLACE} <= set(_columns(first))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a table."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    columns = _columns(lines[0]) if lines else {}
    for name in ("name", *_PLACE, *_LOOK, "focal"):
        if name not in columns:
            raise ValueError(f"{name}: missing among the columns, expected {_expected(name)}")
    for name in columns:
        if name not in _COLUMNS:
            raise ValueError(f"{name}: found among the columns, expected {', '.join(_COLUMNS)}")
    given = set(_UP) & set(columns)
    if given and len(given) < len(_UP):
        raise ValueError(f"up: found {', '.join(sorted(given))}, expected all three or none")
    units = {columns[name] for name in (*_PLACE, *_LOOK)}
    if len(units) > 1:
        found = ", ".join(sorted(unit or "none" for unit in units))
        raise ValueError(f"x ... look_z: found the units {found}, expected one for all six")
    unit = units.pop() or UNKNOWN
    cameras = [_camera(row, columns, image_size) for row in _rows(lines, columns)]
    if not given:
        logger.warning(
            "%s: y is taken to point to the images' top, as the table has no columns up_x, "
            "up_y, up_z",
            path,
        )
    return Rig(tuple(cameras), unit, f"as in {path.name}")


def _camera(
    row: Mapping[str, str], columns: Mapping[str, str], image_size: tuple[int, int] | None
) -> Camera:
    """Return the camera of a line."""
    name = row["name"].strip()
    if not name:
        raise ValueError("name: found nothing in a line, expected the camera's name")
    with errors_of(f"camera {name}"):
        number = {key: as_number(text, key) for key, text in row.items()
                  if key != "name" and text.strip()}  # fmt: skip
        for key in (*_PLACE, *_LOOK, "focal"):
            if key not in number:
                raise ValueError(f"{key}: missing, expected a number")
        size = image_size
        if {"width", "height"} <= set(number):
            size = as_size([number["width"], number["height"]], "width, height")
        size = required_size(size, "such")
        for key in ("focal", "pitch"):
            if not number.get(key, 1.0) > 0:
                raise ValueError(f"{key}: found {number[key]:g}, expected a positive number")
        focal = number["focal"]
        if columns["focal"] != _PIXELS:
            if "pitch" not in number:
                raise ValueError(f"pitch: missing, expected {_expected('pitch')}")
            if bool(columns["focal"]) != bool(columns["pitch"]):
                raise ValueError("focal and pitch: found a unit of one alone, expected focal_mm "
                                 "and pitch_um")  # fmt: skip
            focal *= _length(columns["focal"]) / _length(columns["pitch"]) / number["pitch"]
        up = tuple(number.get(key, float(key == "up_y")) for key in _UP)
        R, t = look_at([number[key] for key in _PLACE], [number[key] for key in _LOOK], up)
        return Camera(name, size, pinhole_matrix(size, focal, focal), R=R, t=t, status="nominal")


def _length(unit: str) -> float:
    """Return the metres of a unit; 1 where there is none."""
    return metres(unit) if unit else 1.0


def _expected(name: str) -> str:
    """Return the columns that a table needs, in words."""
    if name == "focal":
        return "focal_mm and pitch_um, or focal_pixels"
    if name == "pitch":
        return "pitch_um, the distance of neighbouring pixels, or focal_pixels in place of both"
    return f"the head name, {', '.join(_PLACE + _LOOK)}, focal_mm, pitch_um, width, height"


def _delimiter(line: str) -> str:
    """Return the sign that parts the columns of a line."""
    return max(",;\t", key=line.count)


def _columns(line: str) -> dict[str, str]:
    """Return the columns of a table's first line, in order, and the unit of each or nothing."""
    columns = {}
    for text in next(csv.reader([line], delimiter=_delimiter(line)), []):
        name, unit = _name_and_unit(" ".join(text.lower().split()))
        columns["name" if name == "camera" else name] = unit
    return columns


def _name_and_unit(text: str) -> tuple[str, str]:
    """Return name and unit of ``x (mm)``, ``x [mm]``, ``x_mm`` or ``x``."""
    found = re.fullmatch(r"(.*?)\s*(?:\((.*)\)|\[(.*)\]|_([a-zµ]+))", text)
    unit = next(filter(None, found.groups()[1:]), "") if found else ""
    if not found or unit not in (*UNITS, _PIXELS):
        name, unit = text, ""
    else:
        name = found[1]
    name = {"focal_length": "focal", "pixel_pitch": "pitch"}.get(name.replace(" ", "_"), name)
    return name.replace(" ", "_"), unit


def _rows(lines: list[str], columns: Mapping[str, str]) -> Iterator[dict[str, str]]:
    """Yield the texts of each line below the head, by column."""
    delimiter = _delimiter(lines[0])
    for number, texts in enumerate(csv.reader(lines[1:], delimiter=delimiter), 2):
        if len(texts) != len(columns):
            raise ValueError(f"line {number}: found {len(texts)} columns, expected {len(columns)}")
        row = dict(zip(columns, texts, strict=True))
        if delimiter == ";":  # numbers with decimal commas
            row = {k: text if k == "name" else text.replace(",", ".") for k, text in row.items()}
        yield row
