"""Lists of cameras from Blender, by the names of its Python interface, as JSON.

Read only. A list, an object ``cameras`` of entries, or a mapping from names to entries::

    {"name", "matrix_world": 4 x 4, or "location" with "rotation_euler" (radians, "rotation_mode")
     or "rotation_quaternion" (w x y z), "lens" (mm) and "sensor_width" (mm), or "angle_x", or
     "angle"; "sensor_height", "sensor_fit", "shift_x", "shift_y", "resolution_x", "resolution_y",
     "resolution_percentage", "pixel_aspect_x", "pixel_aspect_y", "type"}

Values outside the entries (in an object beside ``cameras``) hold for all. A camera of Blender
looks along -z with y up; ``matrix_world`` is camera to world; shifts are in units of the side that
the view is fitted to; half-pixel centres. ``sensor_fit`` is AUTO by default, shifts 0, aspects 1:
these are Blender's own defaults; lens, sensor and resolution have none here. Names of other
programs taken too: ``transform_matrix``, ``lens_mm``, ``camera_angle_x``, ``width, height``,
``w, h``, ``resolution``. Panoramic and orthographic cameras are refused; lengths have no unit.
https://docs.blender.org/api/current/bpy.types.Camera.html, with the view plane of
``BKE_camera_params_compute_viewplane``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.files.text import read_json, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._image_size import required_size
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    errors_of,
    errors_of_file,
    flat,
    rotation_of_motion,
    usable_name,
)
from rigs.geometry.rotation import matrix_of_quaternion
from rigs.rig import Rig

_MATRIX = ("matrix_world", "transform_matrix")
_LENS = ("lens", "lens_mm", "focal_length_mm")
_ANGLE = ("angle_x", "camera_angle_x", "angle")
_SIZES = (("resolution_x", "resolution_y"), ("width", "height"), ("w", "h"))
_NAMES = ("name", "camera", "filename", "file_path")
_KINDS = ("PERSP", "PERSPECTIVE")
_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds Blender's poses and lenses, and no ``frames``."""
    pose = any(f'"{key}"' in head for key in (*_MATRIX, "rotation_euler", "rotation_quaternion"))
    lens = any(f'"{key}"' in head for key in (*_LENS, *_ANGLE))
    is_transforms = '"frames"' in head or ('"transform_matrix"' in head and '"file_path"' in head)
    return path.suffix == ".json" and pose and lens and not is_transforms


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a list of Blender's cameras.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json(path)
    with errors_of_file(path):
        shared: Mapping[str, Any] = {}
        if isinstance(data, dict) and "cameras" in data:
            shared = {key: value for key, value in data.items() if key != "cameras"}
            data = data["cameras"]
        if isinstance(data, dict):
            entries = list(data.items())
        elif isinstance(data, list):
            entries = [(f"camera{index}", entry) for index, entry in enumerate(data)]
        else:
            entries = []
        if not entries:
            raise ValueError(f"found {shortened(data)}, expected a list of cameras")
        cameras = []
        for key, entry in entries:
            with errors_of(f"camera {key}"):
                values = {**shared, **as_mapping(entry, "entry")}
            name = usable_name(_name(key, entry), path)
            with errors_of(f"camera {name}"):
                size, K = _intrinsics(values, image_size)
                R, t = _pose(values)
            cameras.append(Camera(name, size, K, R=R, t=t, status="calibrated"))
        return Rig(tuple(cameras), UNKNOWN, f"as in {path.name}")


def _name(key: str, entry: Mapping[str, Any]) -> str:
    """Return a camera's name: the entry's own, or the stem of its image, or its key."""
    for field in _NAMES:
        found = entry.get(field)
        if isinstance(found, str) and found.strip():
            is_image = field in _NAMES[2:]
            return PurePosixPath(found.replace("\\", "/")).stem if is_image else found.strip()
    return str(key)


def _first(values: Mapping[str, Any], keys: tuple[str, ...]) -> str | None:
    """Return the first of ``keys`` that is there."""
    return next((key for key in keys if values.get(key) is not None), None)


def _number(values: Mapping[str, Any], key: str, default: float) -> float:
    """Return the number under ``key``."""
    return as_number(values.get(key, default), key)


def _size(values: Mapping[str, Any], image_size: tuple[int, int] | None) -> tuple[int, int]:
    """Return the size of the rendered image."""
    pair = next((keys for keys in _SIZES if _first(values, keys)), None)
    if pair is not None:
        size = [as_count(values.get(key), key) for key in pair]
    elif values.get("resolution") is not None:
        found = flat(values["resolution"], "resolution")
        if len(found) not in (1, 2):
            raise ValueError(f"resolution: found {shortened(values['resolution'])}, expected two")
        size = [as_count(number, "resolution") for number in (found[0], found[-1])]
    else:
        return required_size(image_size, "these Blender")
    percentage = _number(values, "resolution_percentage", 100)
    width, height = (as_count(int(n * percentage / 100), "resolution_percentage") for n in size)
    return width, height


def _intrinsics(
    values: Mapping[str, Any], image_size: tuple[int, int] | None
) -> tuple[tuple[int, int], list[list[float]]]:
    """Return image size and camera matrix.

    Notes
    -----
    With the sensor's side that the view is fitted to, ``s`` pixels of width (or of height times
    ``ratio = aspect_y / aspect_x``) long: ``fx = s lens / sensor``, ``fy = fx / ratio``,
    ``cx = width / 2 - shift_x s``, ``cy = height / 2 + shift_y s / ratio``, the middle of the
    top-left pixel at (0.5, 0.5).
    """
    for key in ("type", "camera_type"):
        kind = values.get(key)
        if kind is not None and kind != "CAMERA" and str(kind).upper() not in _KINDS:
            raise ValueError(f"{key}: found {shortened(kind)}, expected PERSP")
    width, height = _size(values, image_size)
    aspect_x, aspect_y = (_number(values, f"pixel_aspect_{axis}", 1) for axis in "xy")
    fit = values.get("sensor_fit", "AUTO")
    if fit not in ("AUTO", "HORIZONTAL", "VERTICAL"):
        raise ValueError(
            f"sensor_fit: found {shortened(fit)}, expected AUTO, HORIZONTAL or VERTICAL"
        )
    if not (aspect_x > 0 and aspect_y > 0):
        raise ValueError(f"pixel_aspect: found {aspect_x}, {aspect_y}, expected positive numbers")
    ratio = aspect_y / aspect_x
    is_wide = width * aspect_x >= height * aspect_y if fit == "AUTO" else fit == "HORIZONTAL"
    if fit == "AUTO" and not is_wide and _first(values, (*_LENS, *_ANGLE)) == "camera_angle_x":
        raise ValueError(
            "camera_angle_x: found it with an upright image, where Blender means the angle across "
            "its height and other programs that across its width, expected lens and sensor_width"
        )
    side = width if is_wide else height * ratio
    fx = side * _focal_of_sensor(values, fit == "VERTICAL")
    cx = width / 2 - _number(values, "shift_x", 0) * side - 0.5
    cy = height / 2 + _number(values, "shift_y", 0) * side / ratio - 0.5
    return (width, height), [[fx, 0.0, cx], [0.0, fx / ratio, cy], [0.0, 0.0, 1.0]]


def _focal_of_sensor(values: Mapping[str, Any], is_vertical: bool) -> float:
    """Return the focal length in units of the sensor's side that the view is fitted to."""
    key = _first(values, _LENS)
    sensor = "sensor_height" if is_vertical else "sensor_width"
    if key is not None and values.get(sensor) is not None:
        lens, length = as_number(values[key], key), as_number(values[sensor], sensor)
        if not (lens > 0 and length > 0):
            raise ValueError(f"{key}, {sensor}: found {lens} and {length}, expected positive mm")
        return lens / length
    angles = ("angle_y", "camera_angle_y", "angle") if is_vertical else _ANGLE
    angle = _first(values, angles)
    if angle is None:
        missing = _LENS[0] if key is None else sensor
        raise ValueError(f"{missing}: missing, expected lens and {sensor} in mm, or {angles[0]}")
    found = as_number(values[angle], angle)
    if not 0 < found < math.pi:
        raise ValueError(f"{angle}: found {found}, expected radians between 0 and pi")
    return 0.5 / math.tan(found / 2)


def _pose(values: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return OpenCV's world-to-camera ``R`` and ``t``."""
    key = _first(values, _MATRIX)
    if key is not None:
        numbers = flat(values[key], key)
        if len(numbers) not in (12, 16):
            raise ValueError(f"{key}: found {shortened(values[key])}, expected 4 x 4 numbers")
        motion = numbers.reshape(-1, 4)
        to_world, position = rotation_of_motion(motion, key), motion[:3, 3]
    else:
        to_world = _rotation(values)
        position = as_array(values.get("location"), (3,), "location")
    R = np.diag([1.0, -1.0, -1.0]) @ to_world.T
    return R, -R @ position


def _rotation(values: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the rotation of a quaternion or of Euler angles about the fixed axes in turn."""
    from scipy.spatial.transform import Rotation

    mode = values.get("rotation_mode")
    if values.get("rotation_quaternion") is not None and mode in (None, "QUATERNION"):
        q = as_array(values["rotation_quaternion"], (4,), "rotation_quaternion")
        return matrix_of_quaternion(q, "rotation_quaternion")
    if values.get("rotation_euler") is None:
        raise ValueError("matrix_world: missing, expected it or location with rotation_euler")
    mode = "XYZ" if mode is None else mode
    if mode not in _ORDERS:
        raise ValueError(
            f"rotation_mode: found {shortened(mode)}, expected one of {', '.join(_ORDERS)}"
        )
    angles = as_array(values["rotation_euler"], (3,), "rotation_euler")
    about = dict(zip("XYZ", angles, strict=True))
    return Rotation.from_euler(mode.lower(), [about[axis] for axis in mode]).as_matrix()
