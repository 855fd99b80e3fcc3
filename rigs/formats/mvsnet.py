"""MVSNet's camera files, one an image: ``00000000_cam.txt``, as for DTU, BlendedMVS and others.

Read only; a folder of them (``cams``) is a rig. The word ``extrinsic`` and a 4 x 4 matrix, world
to camera in OpenCV's axes; ``intrinsic`` and a 3 x 3 matrix; last DEPTH_MIN, DEPTH_INTERVAL and
sometimes DEPTH_NUM, DEPTH_MAX, which a rig does not need. (0.5, 0.5) is the centre of the top-left
pixel, as in MVSNet's homographies. There is no distortion and no unit. Image sizes are those of
the images of the same number beside the files or in ``../images``, else asked for. DTU's training
files hold intrinsics of images of a quarter of the size: a principal point far from the middle of
an image that was found is refused. Source: README and ``homography_warping.py`` at
https://github.com/YoYo000/MVSNet.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._image_size import image_beside, required_size
from rigs.formats._one_a_camera import cameras_of
from rigs.formats._values import (
    errors_of,
    errors_of_file,
    numbers_of_line,
    read_head,
    rotation_of_motion,
)
from rigs.rig import Rig

_ENDING = "_cam.txt"
_POSE = [f"E{i}{j}" for i in "0123" for j in "0123"]
_MATRIX = [f"K{i}{j}" for i in "012" for j in "012"]
_DEPTHS = ["DEPTH_MIN", "DEPTH_INTERVAL", "DEPTH_NUM", "DEPTH_MAX"]
_OFF_CENTRE = 0.25  # of the image's side; a crop moves a principal point less, a wrong scale more


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder, begins with an extrinsic and an intrinsic."""
    if path.is_dir():
        return bool(_files_of(path))
    return bool(re.match(r"\s*+extrinsic\s", head)) and bool(re.search(r"\sintrinsic\s", head))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a camera's file, or of a folder of them.

    Parameters
    ----------
    path : Path
    image_size : (int, int), optional
        Width and height of all images; by default those of the images of the same names.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    what = f"*{_ENDING}, expected MVSNet's, one an image"
    cameras = cameras_of(path, _files_of, lambda file: _camera(file, image_size), what)
    with errors_of_file(path):
        return Rig(cameras, UNKNOWN, f"as in {path.name}")


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder that are cameras."""
    files = [file for file in sorted(folder.iterdir()) if file.name.endswith(_ENDING)]
    return [file for file in files if file.is_file() and looks_like(file, read_head(file))]


def _camera(file: Path, image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of a file."""
    name = file.name.removesuffix(_ENDING) if file.name.endswith(_ENDING) else file.stem
    words = read_text(file).split()
    with errors_of(f"camera {name}"):
        if words[:1] != ["extrinsic"] or words[17:18] != ["intrinsic"]:
            raise ValueError(
                f"found {shortened(' '.join(words[:18]))}, expected the words extrinsic and "
                "intrinsic before 4 x 4 and 3 x 3 numbers"
            )
        E = np.reshape(numbers_of_line(words[1:17], _POSE), (4, 4))
        K = np.reshape(numbers_of_line(words[18:27], _MATRIX), (3, 3))
        numbers_of_line(words[27:], _DEPTHS[: max(2, len(words) - 27)])
        R = rotation_of_motion(E, "extrinsic")
        image = image_beside((file.parent, file.parent.parent / "images"), name)
        width, height = required_size(image_size, "MVSNet", image)
        off = np.abs(K[:2, 2] / (width, height) - 0.5)
        if image_size is None and (off > _OFF_CENTRE).any():
            raise ValueError(
                f"intrinsic: found principal point {K[0, 2]:g}, {K[1, 2]:g} in {image} of "
                f"{width} x {height}, expected one near its middle: where the file is for images "
                "of another size, --image-size says which"
            )
        K[:2, 2] -= 0.5
    return Camera(name, (width, height), K, R=R, t=E[:3, 3], status="calibrated")
