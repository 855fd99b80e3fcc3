"""EuRoC's ``cam0/sensor.yaml``, as of TUM VI and other sets in its layout.

Read only; a folder of ``cam*`` folders (``mav0``), or one that holds such a folder, is a rig.
``T_BS`` leads from the sensor to the body, whose axes are the world; ``intrinsics`` are
``fu fv cu cv`` and ``distortion_coefficients`` of radial-tangential (OpenCV's k1 k2 p1 p2) or
equidistant (OpenCV's fisheye). Lengths are in metres, pixel centres at integers.
Source: Burri and others, "The EuRoC micro aerial vehicle datasets" (2016).
"""

from __future__ import annotations

import re
from pathlib import Path

from rigs.camera import Camera
from rigs.files.text import shortened
from rigs.formats._file_storage import matrix, read_storage
from rigs.formats._lens import from_vector
from rigs.formats._one_a_camera import cameras_of
from rigs.formats._values import (
    as_array,
    as_size,
    errors_of,
    errors_of_file,
    one_of,
    read_head,
    required,
    rotation_of_motion,
)
from rigs.rig import Rig

_KEYS = ("T_BS", "camera_model", "intrinsics", "resolution")
#: Whether a distortion model is a fisheye.
_LENSES = {"radial-tangential": False, "radtan": False, "equidistant": True}


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder's ``cam*``, is a camera's ``sensor.yaml``."""
    if path.is_dir():
        return bool(_files_of(path))
    return all(re.search(rf"^{key}\s*:", head, re.MULTILINE) for key in _KEYS)


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``sensor.yaml`` or of a folder of ``cam*/sensor.yaml``.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    cameras = cameras_of(path, _files_of, _camera, "cam*/sensor.yaml, expected EuRoC's")
    with errors_of_file(path):
        return Rig(cameras, "m", "the body's axes")


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder's cameras."""
    files = sorted((*folder.glob("cam*/sensor.yaml"), *folder.glob("mav0/cam*/sensor.yaml")))
    return [file for file in files if file.is_file() and looks_like(file, read_head(file))]


def _camera(file: Path) -> Camera:
    """Return the camera of a file, named by its folder."""
    data, name = read_storage(file), file.absolute().parent.name
    with errors_of(f"camera {name}"):
        if data.get("camera_model") != "pinhole":
            raise ValueError(f"camera_model: found {shortened(data.get('camera_model'))}, "
                             "expected pinhole")  # fmt: skip
        kind = one_of(data.get("distortion_model"), _LENSES, "distortion_model")
        what = "distortion_coefficients"
        lens = from_vector(as_array(required(data, what), (4,), what), _LENSES[kind], what)
        fu, fv, cu, cv = as_array(required(data, "intrinsics"), (4,), "intrinsics")
        size = as_size(required(data, "resolution"), "resolution")
        motion = matrix(data, ("T_BS",), (4, 4))
        R = rotation_of_motion(motion, "T_BS").T
    K = [[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]]
    return Camera(name, size, K, lens, R, -R @ motion[:3, 3], status="calibrated")
