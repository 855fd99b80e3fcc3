"""Kalibr's ``camchain.yaml``: each camera's pose from the one before it.

``cam0, cam1 ...: {camera_model, intrinsics, distortion_model, distortion_coeffs, resolution,
T_cn_cnm1}`` with ``x_cam = T_cn_cnm1 @ x_camera_before``; the world is the first camera's axes,
lengths are in metres, pixel centres at integers. radtan is OpenCV's k1 k2 p1 p2, equidistant its
fisheye; omni, ds and eucm become tables of rays.
https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_yaml_mapping
from rigs.formats._lens import SPHERES, sphere_table
from rigs.formats._values import (
    as_array,
    as_mapping,
    as_size,
    errors_of,
    one_of,
    required,
    rotation_of_motion,
)
from rigs.lens import Distortion
from rigs.rig import Rig

#: Permitted distortion models of each camera model, with their names in `rigs.lens`.
_LENSES = {
    "pinhole": {"radtan": "brown", "equidistant": "fisheye", "none": "none"},
    "omni": {"radtan": "brown", "none": "none"},
    "ds": {"none": "none"},
    "eucm": {"none": "none"},
}


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds ``cam0`` with Kalibr's ``camera_model`` and ``intrinsics``."""
    return bool(
        re.search(r"^cam\d+\s*:", head, re.MULTILINE)
        and re.search(r"^[ \t]++camera_model\s*:", head, re.MULTILINE)
        and re.search(r"^[ \t]++intrinsics\s*:", head, re.MULTILINE)
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``camchain.yaml``."""
    data = read_yaml_mapping(path)
    names = sorted(
        (name for name in data if re.fullmatch(r"cam\d{1,6}", name)), key=lambda n: int(n[3:])
    )
    if not names:
        raise ValueError("cam0: missing, expected a camera")
    cameras = []
    pose = np.eye(4)
    for index, name in enumerate(names):
        with errors_of(f"camera {name}"):
            if int(name[3:]) != index:
                raise ValueError(f"found no cam{index} before it, expected consecutive numbers")
            entry = as_mapping(data[name], "entry")
            if index:
                pose = _link(required(entry, "T_cn_cnm1")) @ pose
        cameras.append(_camera(name, entry, pose))
    return Rig(tuple(cameras), "m", "cam0's axes")


def _link(found: object) -> NDArray[np.float64]:
    """Return a rigid motion ``(4, 4)``."""
    motion = as_array(found, (4, 4), "T_cn_cnm1")
    motion[:3, :3] = rotation_of_motion(motion, "T_cn_cnm1")
    return motion


def _camera(name: str, entry: Mapping[str, Any], pose: NDArray) -> CameraLike:
    """Return the camera of an entry at a pose ``(4, 4)``."""
    with errors_of(f"camera {name}"):
        model = one_of(required(entry, "camera_model"), _LENSES, "camera_model")
        lens = one_of(required(entry, "distortion_model"), _LENSES[model], "distortion_model")
        count = len(SPHERES.get(model, ()))
        intrinsics = as_array(required(entry, "intrinsics"), (count + 4,), "intrinsics").tolist()
        fu, fv, pu, pv = intrinsics[count:]
        size = as_size(required(entry, "resolution"), "resolution")
        if lens == "none":
            distortion = Distortion()
        else:
            given = as_array(required(entry, "distortion_coeffs"), (4,), "distortion_coeffs")
            distortion = Distortion(_LENSES[model][lens], tuple(given))
    R, t = pose[:3, :3], pose[:3, 3]
    K = [[fu, 0.0, pu], [0.0, fv, pv], [0.0, 0.0, 1.0]]
    camera = Camera(name, size, K, distortion, R, t, status="calibrated")
    if model == "pinhole":
        return camera
    with errors_of(f"camera {name}"):
        return sphere_table(camera, model, intrinsics[:count])
