"""multical's ``calibration.json``: OpenCV's cameras by name, and their poses by name.

Read only. ``cameras: {name: {model, image_size, K, dist}}`` with model standard, rational,
thin_prism or tilted; ``camera_poses: {name: {R, T}}`` with ``x_cam = R @ x_rig + T``, named
``name_to_master`` where a camera was made the master, whose axes then are the rig's. Pixel centres
are at integers; lengths are in the unit of the boards, which the file does not name.
Source: ``multical/io/export_calib.py`` at https://github.com/oliver-batchelor/multical.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import read_json_mapping
from rigs.files.units import UNKNOWN
from rigs.formats._lens import from_vector
from rigs.formats._values import (
    as_array,
    as_mapping,
    as_rotation,
    as_size,
    errors_of,
    flat,
    one_of,
    required,
    usable_name,
)
from rigs.rig import Rig

_MODELS = ("standard", "rational", "thin_prism", "tilted")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds cameras with ``K`` and ``dist``, and poses."""
    return path.suffix == ".json" and '"camera_poses"' in head and '"dist"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``calibration.json``."""
    data = read_json_mapping(path)
    entries = as_mapping(required(data, "cameras"), "cameras")
    poses = as_mapping(required(data, "camera_poses"), "camera_poses")
    masters = [name for name in poses if name in entries]
    cameras = []
    for name, entry in entries.items():
        keys = [name, *(f"{name}_to_{master}" for master in masters)]
        pose = next((poses[key] for key in keys if key in poses), None)
        if pose is None:
            raise ValueError(f"camera {name}: camera_poses: missing, expected R and T")
        cameras.append(_camera(usable_name(name, path), entry, pose))
    return Rig(tuple(cameras), UNKNOWN, f"as in {path.name}")


def _camera(name: str, entry: Mapping[str, Any], pose: Mapping[str, Any]) -> Camera:
    """Return the camera of an entry and a pose."""
    with errors_of(f"camera {name}"):
        entry, pose = as_mapping(entry, "entry"), as_mapping(pose, "camera_poses")
        one_of(required(entry, "model"), _MODELS, "model")
        K = as_array(required(entry, "K"), (3, 3), "K")
        distortion = from_vector(flat(required(entry, "dist"), "dist"), False, "dist")
        size = as_size(required(entry, "image_size"), "image_size")
        R = as_rotation(required(pose, "R"), "R")
        t = as_array(flat(required(pose, "T"), "T"), (3,), "T")
    return Camera(name, size, K, distortion, R, t, status="calibrated")
