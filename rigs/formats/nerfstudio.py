"""nerfstudio's ``camera_path.json``: a list of pinholes, as its viewer writes it.

Read only. ``render_width, render_height`` and ``camera_path``, a list of
``{camera_to_world, fov}``: 16 numbers row by row, OpenGL's axes (x right, y up, z backwards), and
the vertical field of view in degrees. The axis meets the image in its middle. Lengths are in the
unit of the trained scene, which is moved and scaled against the images' own poses. Cameras of
other types than perspective are refused; so are the lists that ``ns-export cameras`` writes, which
hold poses without any focal length. Source: ``get_path_from_json`` in
``nerfstudio/cameras/camera_paths.py`` at https://github.com/nerfstudio-project/nerfstudio.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_json, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    errors_of,
    errors_of_file,
    required,
    rotation_of_motion,
)
from rigs.rig import Rig


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is a path of cameras, or a list of exported poses."""
    is_list = head.lstrip().startswith("[") and '"transform"' in head and '"file_path"' in head
    return path.suffix == ".json" and ('"camera_path"' in head or is_list)


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``camera_path.json``.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json(path)
    with errors_of_file(path):
        if not isinstance(data, dict):
            raise ValueError(
                "fov: missing, as ns-export's lists hold poses alone, expected camera_path, or "
                "the transforms.json that the scene was trained on"
            )
        if data.get("camera_type", "perspective") != "perspective":
            raise ValueError(
                f"camera_type: found {shortened(data['camera_type'])}, expected perspective"
            )
        entries = required(data, "camera_path")
        if not isinstance(entries, list) or not entries:
            raise ValueError(f"camera_path: found {shortened(entries)}, expected a list")
        keys = ("render_width", "render_height")
        width, height = (as_count(required(data, key), key) for key in keys)
        cameras = (_camera(f"camera{i}", e, (width, height)) for i, e in enumerate(entries))
        return Rig(tuple(cameras), UNKNOWN, f"as in {path.name}")


def _camera(name: str, entry: object, size: tuple[int, int]) -> Camera:
    """Return the camera of an entry."""
    with errors_of(f"camera {name}"):
        entry = as_mapping(entry, "entry")
        found = as_array(required(entry, "camera_to_world"), (16,), "camera_to_world")
        pose = found.reshape(4, 4)
        R = np.diag([1.0, -1.0, -1.0]) @ rotation_of_motion(pose, "camera_to_world").T
        fov = as_number(required(entry, "fov"), "fov")
        if not 0 < fov < 180:
            raise ValueError(f"fov: found {fov}, expected more than 0 and less than 180 degrees")
    width, height = size
    f = height / 2 / np.tan(np.deg2rad(fov) / 2)
    K = [[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]]
    return Camera(name, size, K, R=R, t=-R @ pose[:3, 3], status="calibrated")
