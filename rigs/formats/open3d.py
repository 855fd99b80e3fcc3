"""Open3D's JSON of ``PinholeCameraTrajectory`` and ``PinholeCameraParameters``.

Read only. ``parameters``: a list of cameras, each with ``extrinsic``, world to camera in OpenCV's
axes, 16 numbers *column by column*, and ``intrinsic: {width, height, intrinsic_matrix}``, nine
numbers column by column. Pixel centres are at integers, as where Open3D makes points of a depth
image; the camera that its viewer saves has its axis at ``width / 2 - 0.5``. There is no lens and
no unit. Source: ``cpp/open3d/camera`` at https://github.com/isl-org/Open3D.
"""

from __future__ import annotations

from pathlib import Path

from rigs.camera import Camera
from rigs.files.text import read_json_mapping, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    errors_of,
    errors_of_file,
    required,
    rotation_of_motion,
)
from rigs.rig import Rig


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has Open3D's matrix and a class of cameras."""
    return path.suffix == ".json" and "PinholeCamera" in head and '"intrinsic_matrix"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a trajectory, or of one camera.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json_mapping(path)
    with errors_of_file(path):
        entries = data.get("parameters", [data])
        if not isinstance(entries, list) or not entries:
            raise ValueError(f"parameters: found {shortened(entries)}, expected a list of cameras")
        cameras = tuple(_camera(f"camera{i}", entry) for i, entry in enumerate(entries))
        return Rig(cameras, UNKNOWN, f"as in {path.name}")


def _camera(name: str, entry: object) -> Camera:
    """Return the camera of an entry."""
    with errors_of(f"camera {name}"):
        entry = as_mapping(entry, "entry")
        lens = as_mapping(required(entry, "intrinsic"), "intrinsic")
        size = tuple(as_count(required(lens, side), side) for side in ("width", "height"))
        found = as_array(required(lens, "intrinsic_matrix"), (9,), "intrinsic_matrix")
        motion = as_array(required(entry, "extrinsic"), (16,), "extrinsic").reshape(4, 4).T
        R = rotation_of_motion(motion, "extrinsic")
    K = found.reshape(3, 3).T
    return Camera(name, size, K, R=R, t=motion[:3, 3], status="calibrated")
