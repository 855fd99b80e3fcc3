"""BOP's ``scene_camera.json``: one pinhole for each image of a scene.

Read only. ``{"<image>": {cam_K, cam_R_w2c, cam_t_w2c, depth_scale}}``, matrices row by row,
``x_cam = R @ x_world + t`` in mm, OpenCV's axes, pixel centres at integers (the toolkit's own
conversion of depth images takes column and row as they are). Cameras are named like BOP's images,
``000000``. The format has no image size: it is that of ``rgb/000000.png`` or ``gray/000000.png``
beside the file, or has to be given, unless an entry has ``width`` and ``height``. Images are
without distortion. The pose in the world is optional in BOP, and a file without is refused.
https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import read_json_mapping, shortened
from rigs.formats._image_size import image_beside, required_size
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_rotation,
    errors_of,
    errors_of_file,
    required,
)
from rigs.rig import Rig

_FOLDERS = ("rgb", "gray")
_POSE = "the image's pose in the scene: without poses the file holds no rig"


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file holds entries with ``cam_K``."""
    return path.suffix == ".json" and '"cam_K"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``scene_camera.json``, a camera for each of its images.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json_mapping(path)
    with errors_of_file(path):
        if not data:
            raise ValueError("found no images, expected at least one")
        cameras = tuple(_camera(path.parent, key, data[key], image_size) for key in data)
        return Rig(cameras, "mm", "the scene's axes")


def _camera(folder: Path, key: str, found: object, image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of an image."""
    if not (key.isdecimal() and key.isascii() and len(key) <= 9):
        raise ValueError(f"{shortened(key)}: found it among the images, expected their numbers")
    name = f"{int(key):06d}"
    with errors_of(f"camera {name}"):
        entry: Mapping[str, Any] = as_mapping(found, "entry")
        K = _rows(entry, "cam_K", "9 numbers").reshape(3, 3)
        R = as_rotation(_rows(entry, "cam_R_w2c", _POSE).reshape(3, 3), "cam_R_w2c")
        t = as_array(required(entry, "cam_t_w2c", _POSE), (3,), "cam_t_w2c")
        folders = [folder / sub for sub in _FOLDERS]
        image = image_beside(folders, name) or folders[0] / f"{name}.png"
        if "width" in entry:  # of some writers
            size = tuple(as_count(entry.get(key), key) for key in ("width", "height"))
        else:
            size = required_size(image_size, "BOP's scene_camera", image)
    return Camera(name, size, K, R=R, t=t, status="calibrated")


def _rows(entry: Mapping[str, Any], key: str, expected: str) -> Any:
    """Return the nine numbers of a matrix."""
    return as_array(required(entry, key, expected), (9,), key)
