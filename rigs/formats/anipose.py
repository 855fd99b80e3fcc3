"""The TOML of anipose, Pose2Sim, FreeMoCap and caliscope: OpenCV's cameras, one table each.

A camera is a table, of any name, of ``name, size, matrix, distortions, rotation, translation,
fisheye``; caliscope's ``camera_array.toml`` has them in ``[cameras.0] ...``. Tables without any of
these, like ``[metadata]``, are no cameras, and neither are the pairs ``[stereo_0_1]`` of older
caliscope. ``x_cam = R(rotation) @ x_world + translation``, rotation as OpenCV's rvec or a 3 x 3
matrix; pixel centres at integers; lengths in the unit of the board, which the files do not name.
Source: ``aniposelib/cameras.py`` at https://github.com/lambdaloop/aniposelib and
``src/caliscope/persistence.py`` at https://github.com/mprib/caliscope.
"""

from __future__ import annotations

import logging
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import read_text
from rigs.files.units import UNKNOWN
from rigs.formats._lens import from_vector
from rigs.formats._values import (
    as_array,
    as_mapping,
    as_rotation,
    as_size,
    errors_of,
    flat,
    required,
    usable_name,
)
from rigs.geometry.rotation import matrix_of_vector
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_POSE = ("rotation", "translation")
_PAIR = re.compile(r"stereo_.+_.+")
_OF_CAMERAS = {"matrix", "distortions", "rotation", "translation"}
_DEEP_KEY = r"(?<![^\s.,=\[\]{}])(?:[^\s.,=\[\]{}]++[ \t]*+\.[ \t]*+){32}"


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is TOML of cameras with ``matrix`` or ``distortions``."""
    return path.suffix == ".toml" and bool(
        re.search(r"^[ \t]*+(?:distortions|matrix)\s*=", head, re.MULTILINE)
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``calibration.toml`` or a ``camera_array.toml``."""
    text = read_text(path)
    if re.search(_DEEP_KEY, text):  # tomllib's time and memory grow with its square
        raise ValueError("broken TOML: nested too deeply")
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise ValueError("broken TOML: nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"broken TOML: {error}") from None
    entries = _tables(data)
    if not entries:
        raise ValueError(
            f"cameras: found none in {', '.join(map(str, data)) or 'no tables'}, expected "
            "tables like [cam_0] or [cameras.0] of matrix, distortions, rotation, translation"
        )
    lost = [key for key, entry in entries.items() if not any(map(entry.get, _POSE))]
    if len(lost) == len(entries):
        raise ValueError(
            f"rotation, translation: found neither in any of {len(lost)} cameras, expected "
            "both: the cameras' poses are not calibrated yet"
        )
    if lost:
        logger.warning("%s: left out %d cameras without a pose: %s", path, len(lost),
                       ", ".join(lost))  # fmt: skip
    cameras = [_camera(key, entry, path) for key, entry in entries.items() if key not in lost]
    return Rig(tuple(cameras), UNKNOWN, f"as in {path.name}")


def _tables(data: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the cameras' tables by their names: those of ``cameras`` and others like them."""
    inner = data.get("cameras")
    if isinstance(inner, dict) and not inner.keys() & _OF_CAMERAS:
        listed = {key: as_mapping(table, f"camera {key}") for key, table in inner.items()}
    else:
        listed = {}
    others = {
        key: table
        for key, table in data.items()
        if isinstance(table, dict)
        and (table.keys() & _OF_CAMERAS or re.fullmatch(r"cam(era)?_?\d+", key))
        and not _PAIR.fullmatch(key)
    }
    return {
        key: {name: None if value == "null" else value for name, value in table.items()}
        for key, table in {**listed, **others}.items()
        if table.get("ignore") is not True
    }


def _camera(key: str, entry: Mapping[str, Any], path: Path) -> Camera:
    """Return the camera of a table."""
    name = str(entry.get("name", f"cam{key}" if key.isdecimal() else key))
    name = usable_name(name, path)
    with errors_of(f"camera {name}"):
        K = as_array(required(entry, "matrix"), (3, 3), "matrix")
        fisheye = entry.get("fisheye", False) is True
        lens = flat(required(entry, "distortions"), "distortions")
        distortion = from_vector(lens, fisheye, "distortions")
        size = as_size(required(entry, "size"), "size")
        turn = flat(required(entry, "rotation"), "rotation")
        R = (
            matrix_of_vector(turn)
            if len(turn) == 3
            else as_rotation(entry["rotation"], "rotation")
        )
        t = as_array(flat(required(entry, "translation"), "translation"), (3,), "translation")
    return Camera(name, size, K, distortion, R, t, status="calibrated")
