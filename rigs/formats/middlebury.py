"""Middlebury multi-view stereo: ``*_par.txt``, one line per image.

Read only. First the number of images, then for each its name, the camera matrix K, R and t row by
row: ``imgname.png k11 ... k33 r11 ... r33 t1 t2 t3``. The image of a point is ``K (R x + t)`` in
OpenCV's axes, world to camera, with the origin at the top left; pixel centres are taken at
integers. There is no distortion; the sets are in metres. Image sizes come from the images in the
file's folder. Source: README of the sets at https://vision.middlebury.edu/mview/data/.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text, shortened
from rigs.formats._values import as_number, as_rotation, errors_of, numbers_of_line, required_size
from rigs.rig import Rig

_TURN = [f"r{i}{j}" for i in "123" for j in "123"]
_NAMES = [f"k{i}{j}" for i in "123" for j in "123"] + _TURN + ["t1", "t2", "t3"]

LENGTH_UNIT = "m"


def looks_like(path: Path, head: str) -> bool:
    """Return whether ``head``, the file's first characters, is a count and a line of 22 words."""
    first = r"\s*+\d++[^\S\n]*+\n\s*+\S+\.\w++"
    return bool(re.match(first + r"(\s++[-+.\deE]++){21}[^\S\n]*+(\n|$)", head))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``*_par.txt``; the cameras are named by their images' stems."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    if not lines:
        raise ValueError("found an empty file, expected the number of images")
    count = as_number(lines[0], "number of images")
    if count != len(lines) - 1 or count < 1:
        raise ValueError(
            f"number of images: found {shortened(lines[0].strip())} and {len(lines) - 1} "
            "lines, expected one line per image"
        )
    cameras = [_camera(line, path.parent, image_size) for line in lines[1:]]
    return Rig(tuple(cameras), LENGTH_UNIT, f"as in {path.name}")


def _camera(line: str, folder: Path, image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of one line."""
    image, *words = line.split()
    name = PurePosixPath(image).stem
    with errors_of(f"camera {name}"):
        values = np.array(numbers_of_line(words, _NAMES))
        K, R = (values[:9].reshape(3, 3), as_rotation(values[9:18].reshape(3, 3), "r11 ... r33"))
        size = required_size(image_size, "Middlebury", folder / PurePosixPath(image).name)
    return Camera(name, size, K, R=R, t=values[18:], status="calibrated")
