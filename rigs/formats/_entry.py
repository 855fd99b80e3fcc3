"""One entry of a ``transforms.json``: its camera, in our conventions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import LensCamera
from rigs.formats._lens import SLOTS, named_model, refuse_skew
from rigs.formats._values import (
    as_array,
    as_count,
    as_number,
    one_of,
    required,
    rotation_of_motion,
)
from rigs.lens import Distortion

#: Our model for each of the format's, and how many of its `SLOTS` are used; others must be 0.
_MODELS = {
    "SIMPLE_PINHOLE": ("none", 0),
    "PINHOLE": ("none", 0),
    "SIMPLE_RADIAL": ("brown", 1),
    "RADIAL": ("brown", 2),
    "OPENCV": ("brown", 5),
    "FULL_OPENCV": ("rational", 8),
    "OPENCV_FISHEYE": ("fisheye", 4),
}


def entry_camera(entry: Mapping[str, Any], shared: Mapping[str, Any]) -> Camera:
    """Return the camera of one entry, under a placeholder name."""
    values = {**{k: v for k, v in shared.items() if k != "frames"}, **entry}
    if "transform_matrix" not in entry:
        raise ValueError("transform_matrix: missing, expected a 4 x 4 camera-to-world matrix")
    R, t = _pose(entry["transform_matrix"])
    distortion = _distortion(values)
    width, height = (as_count(required(values, key), key) for key in ("w", "h"))
    fx, fy = _focal_lengths(entry, shared, width, height, distortion.model)
    cx = _number(values, "cx", width / 2) - 0.5  # the format's pixel centres are at halves
    cy = _number(values, "cy", height / 2) - 0.5
    K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    return Camera("entry", (width, height), K, distortion, R, t, status="calibrated")


def camera_entry(camera: LensCamera) -> dict[str, Any]:
    """Return the entry of a camera, the inverse of `entry_camera`."""
    refuse_skew(camera, "transforms.json")
    model, coefficients = named_model(camera, "transforms.json")
    (fx, _, cx), (_, fy, cy) = camera.camera_matrix[:2].tolist()
    pose = np.eye(4)
    pose[:3, :3] = camera.R.T @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = camera.position
    width, height = camera.image_size
    entry = {"w": width, "h": height, "fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5}
    fisheye = {"is_fisheye": True} if model == "OPENCV_FISHEYE" else {}
    return {
        "camera_model": model,
        **fisheye,
        **entry,
        **coefficients,
        "transform_matrix": pose.tolist(),
    }


def _pose(matrix: object) -> tuple[NDArray, NDArray]:
    """Return OpenCV's world-to-camera ``R`` and ``t`` of OpenGL's camera-to-world matrix."""
    pose = as_array(matrix, (None, 4), "transform_matrix")
    if len(pose) not in (3, 4):
        raise ValueError(f"transform_matrix: found {len(pose)} rows, expected 4")
    R = np.diag([1.0, -1.0, -1.0]) @ rotation_of_motion(pose, "transform_matrix").T
    return R, -R @ pose[:3, 3]


def _distortion(values: Mapping[str, Any]) -> Distortion:
    """Return the lens of an entry."""
    lens = {key: _number(values, key, 0.0) for key in SLOTS["rational"]}
    given = values.get("camera_model")
    if given is None:
        given = "OPENCV_FISHEYE" if values.get("is_fisheye") else "OPENCV"
    given = one_of(given, _MODELS, "camera_model")
    model, count = _MODELS[given]
    for key, value in lens.items():
        if value != 0 and key not in SLOTS[model][:count]:
            raise ValueError(f"{key}: found {value}, expected 0 for camera_model {given}")
    if model == "none" or (model == "brown" and not any(lens.values())):
        return Distortion()
    return Distortion(model, tuple(lens[key] for key in SLOTS[model]))


def _focal_lengths(
    entry: Mapping[str, Any], shared: Mapping[str, Any], width: float, height: float, model: str
) -> tuple[float, float]:
    """Return the focal lengths in pixels; the entry's own keys precede the file's."""
    for values in (entry, shared):
        if "fl_x" in values:
            fx = _positive(values, "fl_x")
            return fx, _positive(values, "fl_y") if "fl_y" in values else fx
        if "camera_angle_x" in values:
            if model == "fisheye":
                raise ValueError("fl_x: missing, expected it with a fisheye, not camera_angle_x")
            fx = _from_angle(values, "camera_angle_x", width)
            has_y = "camera_angle_y" in values
            return fx, _from_angle(values, "camera_angle_y", height) if has_y else fx
    raise ValueError("fl_x: missing, expected fl_x or camera_angle_x")


def _from_angle(values: Mapping[str, Any], key: str, size: float) -> float:
    """Return the focal length in pixels of a field of view over ``size`` pixels."""
    angle = _positive(values, key)
    if angle >= math.pi:
        raise ValueError(f"{key}: found {angle}, expected less than pi radians")
    return size / 2 / math.tan(angle / 2)


def _number(values: Mapping[str, Any], key: str, default: float | None = None) -> float:
    """Return the number under ``key``."""
    if default is not None and key not in values:
        return default
    return as_number(required(values, key), key)


def _positive(values: Mapping[str, Any], key: str) -> float:
    """Return the positive number under ``key``."""
    number = _number(values, key)
    if not number > 0:
        raise ValueError(f"{key}: found {number}, expected a positive number")
    return number
