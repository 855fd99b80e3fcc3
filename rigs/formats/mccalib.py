"""MC-Calib's ``calibrated_cameras_data.yml``: OpenCV's cameras and their poses.

Read only. ``nb_camera`` and for each camera ``camera_<i>: {camera_matrix, distortion_vector,
distortion_type, camera_group, img_width, img_height, camera_pose_matrix}``. The type is 0 for
OpenCV's perspective lens and 1 for its fisheye; the pose is *camera to reference camera*, 4 x 4.
Pixel centres are at integers; lengths are in the unit of the boards, which the file does not
name. Cameras of several groups have no common axes and are refused.
Source: ``Calibration::saveCamerasParams`` in ``McCalib/src/McCalib.cpp`` at
https://github.com/rameau-fr/MC-Calib.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import shortened
from rigs.files.units import UNKNOWN
from rigs.formats._file_storage import keys_found, matrix, read_storage, vector
from rigs.formats._lens import from_vector
from rigs.formats._values import (
    as_count,
    as_mapping,
    as_number,
    errors_of,
    errors_of_file,
    required,
    rotation_of_motion,
)
from rigs.rig import Rig

_TYPES = {0.0: False, 1.0: True}  # distortion_type: whether it is a fisheye


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds ``camera_pose_matrix`` and ``distortion_vector``."""
    return path.suffix in (".yml", ".yaml", ".xml", ".json") and all(
        re.search(rf'(?m)["\s<]{key}\b', head)
        for key in ("camera_pose_matrix", "distortion_vector")
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``calibrated_cameras_data.yml``.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_storage(path)
    with errors_of_file(path):
        names = [name for name in data if re.fullmatch(r"camera_\d+", name)]
        if not names:
            raise ValueError(f"camera_0: missing, found {keys_found(data)}, expected a camera")
        if "nb_camera" in data and as_count(data["nb_camera"], "nb_camera") != len(names):
            raise ValueError(
                f"nb_camera: found {data['nb_camera']}, expected {len(names)} as there are cameras"
            )
        groups = {}
        for name in names:
            with errors_of(f"camera {name}"):
                groups[name] = required(as_mapping(data[name], "entry"), "camera_group")
            if groups[name] != groups[names[0]]:
                raise ValueError(
                    f"camera {name}: camera_group: found {shortened(groups[name])}, expected "
                    f"{shortened(groups[names[0]])} as of {names[0]}: groups have no common axes"
                )
        cameras = tuple(_camera(name, data[name]) for name in names)
        return Rig(cameras, UNKNOWN, "the reference camera's axes")


def _camera(name: str, entry: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry."""
    with errors_of(f"camera {name}"):
        K = matrix(entry, ("camera_matrix",), (3, 3))
        kind = as_number(required(entry, "distortion_type"), "distortion_type")
        if kind not in _TYPES:
            raise ValueError(
                f"distortion_type: found {kind:g}, expected 0 (perspective) or 1 (fisheye)"
            )
        lens = vector(entry, ("distortion_vector",))
        distortion = from_vector(lens, _TYPES[kind], "distortion_vector")
        size = tuple(as_count(entry.get(key), key) for key in ("img_width", "img_height"))
        pose = matrix(entry, ("camera_pose_matrix",), (4, 4))
        R = rotation_of_motion(pose, "camera_pose_matrix").T
    return Camera(name, size, K, distortion, R, -R @ pose[:3, 3], status="calibrated")
