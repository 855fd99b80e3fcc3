"""Basalt's ``calibration.json``: cameras and their poses in an inertial sensor's axes.

Read only. Lists ``T_imu_cam`` (camera to sensor: px py pz and the quaternion qx qy qz qw),
``intrinsics`` (``camera_type`` and its parameters by name) and ``resolution``, under ``value0``.
Known are pinhole, kb4 (OpenCV's fisheye) and pinhole-radtan8 (OpenCV's rational lens); ds, eucm
and ucm, which `rigs.lens` lacks, become tables of rays. Lengths are in metres, pixel centres at
integers. Source: ``include/basalt/camera`` at
https://gitlab.com/VladyslavUsenko/basalt-headers.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_json_mapping
from rigs.formats._image_size import check_tables
from rigs.formats._sphere_models import table_of
from rigs.formats._values import (
    as_mapping,
    as_number,
    as_size,
    errors_of,
    errors_of_file,
    one_of,
    required,
)
from rigs.geometry.rotation import matrix_of_quaternion
from rigs.lens import Distortion
from rigs.rig import Rig

#: Of each type: our model, or the sphere model that makes its table, and its parameters in order.
_TYPES = {
    "pinhole": ("none", ()),
    "kb4": ("fisheye", ("k1", "k2", "k3", "k4")),
    "pinhole-radtan8": ("rational", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "ds": ("ds", ("xi", "alpha")),
    "eucm": ("eucm", ("alpha", "beta")),
    "ucm": ("eucm", ("alpha",)),
}
_POSE = ("qw", "qx", "qy", "qz", "px", "py", "pz")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has Basalt's poses and camera types."""
    return path.suffix == ".json" and '"T_imu_cam"' in head and '"camera_type"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``calibration.json``.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json_mapping(path)
    with errors_of_file(path):
        data = as_mapping(data.get("value0", data), "value0")
        lists = [required(data, key) for key in ("T_imu_cam", "intrinsics", "resolution")]
        if not all(isinstance(one, list) for one in lists) or len({len(one) for one in lists}) > 1:
            raise ValueError(
                "T_imu_cam, intrinsics, resolution: found lists of unequal length, expected one "
                "item a camera in each"
            )
        cameras: list[CameraLike] = []
        for index, (pose, entry, size) in enumerate(zip(*lists, strict=True)):
            cameras.append(_camera(f"cam{index}", pose, entry, size))
            check_tables(cameras)
        return Rig(tuple(cameras), "m", "the inertial sensor's axes")


def _camera(name: str, pose: object, entry: object, found_size: object) -> CameraLike:
    """Return the camera of an item of each list."""
    with errors_of(f"camera {name}"):
        pose = as_mapping(pose, "T_imu_cam")
        qw, qx, qy, qz, *position = (as_number(required(pose, key), key) for key in _POSE)
        R = matrix_of_quaternion([qw, qx, qy, qz], "qw, qx, qy, qz").T
        entry = as_mapping(entry, "intrinsics")
        kind = one_of(entry.get("camera_type"), _TYPES, "camera_type")
        values: dict[str, Any] = as_mapping(required(entry, "intrinsics"), "intrinsics")
        fx, fy, cx, cy = (as_number(required(values, k), k) for k in ("fx", "fy", "cx", "cy"))
        model, keys = _TYPES[kind]
        lens = [as_number(required(values, key), key) for key in keys]
        is_table = model in ("ds", "eucm")
        distortion = Distortion() if is_table else Distortion(model, tuple(lens))
        size = as_size(found_size, "resolution")
    K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    t = -R @ np.array(position)
    camera = Camera(name, size, K, distortion, R, t, status="calibrated")
    if not is_table:
        return camera
    with errors_of(f"camera {name}"):
        return table_of(camera, model, lens if kind != "ucm" else (lens[0], 1.0))
