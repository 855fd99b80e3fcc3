"""MyPTV's camera files, one per camera: name, position, angles, focal length, centre, correction.

Read only; a folder of them is a rig. With ``M = Rx(tx) Ry(ty) Rz(tz)`` of the angles theta, the
ray of pixel (eta, zeta), column and row with centres at integers, is::

    O + s ([eta - w/2 - xh, zeta - h/2 - yh, f] + E Z) @ M
    Z = [eta, zeta, eta^2, zeta^2, eta zeta, eta^3, eta^2 zeta, eta zeta^2, zeta^3]

E is 3 x 5 or 3 x 9. Without the correction (E = 0) that is a pinhole, ``x_cam = M (X - O)``; with
it the camera becomes a table of rays. Lengths are in mm. Newer files have a line ``Tsai model
camera`` before the name and the image size w, h after it; older ones hold no image size. The
files do not say which of eta and zeta counts columns: a camera calibrated in the other order is
mirrored, and looks away from its scene. MyPTV's other model, extendedZolof, is refused.
Source: ``myptv/imaging_mod.py`` and ``myptv/TsaiModel/camera.py`` at
https://github.com/ronshnapp/MyPTV.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_text
from rigs.formats._lens import check_table_size
from rigs.formats._values import (
    as_count,
    cameras_of,
    errors_of,
    numbers_of_line,
    read_head,
    required_size,
)
from rigs.geometry.image_checks import pixel_centres
from rigs.geometry.rotation import matrix_of_angles
from rigs.ray_table import RayTable
from rigs.rig import Rig

LENGTH_UNIT = "mm"
_LINES = (("O_x", "O_y", "O_z"), ("theta_x", "theta_y", "theta_z"), ("f",), ("xh", "yh"))
_TERMS = (5, 9)
_TAG, _OTHER_MODEL = "Tsai model camera", "extendedZolof"  # how newer files begin


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder, has the lines of a camera."""
    if path.is_dir():
        return bool(_files_of(path))
    lines = head.strip("\n").split("\n")
    if lines[0].startswith(_OTHER_MODEL):
        return True  # load() explains the other model
    lines, _ = _untagged(lines)
    if len(lines) != 8 or not lines[0].strip():
        return False
    counts = [_count_of_numbers(line) for line in lines[1:]]
    return (
        counts[:4] == [len(names) for names in _LINES]
        and counts[4] in _TERMS
        and len(set(counts[4:])) == 1
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a camera's file, or of a folder of them."""
    what = "camera files, expected MyPTV's"
    cameras = cameras_of(path, _files_of, lambda file: _camera(read_text(file), image_size), what)
    return Rig(cameras, LENGTH_UNIT, f"as in {path.name}")


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder that are cameras."""
    files = [file for file in sorted(folder.iterdir()) if file.is_file()]
    return [
        file for file in files if file.suffix in ("", ".txt") and looks_like(file, read_head(file))
    ]


def _untagged(lines: list[str]) -> tuple[list[str], str | None]:
    """Return the lines common to old and new files, and the line of the image size or None."""
    if lines[0].strip() != _TAG or len(lines) < 3:
        return lines, None
    return [lines[1], *lines[3:]], lines[2]


def _count_of_numbers(line: str) -> int:
    """Return the count of numbers in a line, or -1 if another word is in it."""
    try:
        return len([float(word) for word in line.split()])
    except ValueError:
        return -1


def _camera(text: str, image_size: tuple[int, int] | None) -> CameraLike:
    """Return the camera of a file."""
    lines, size_line = _untagged(text.strip("\n").split("\n"))
    if lines[0].startswith(_OTHER_MODEL):
        raise ValueError(f"model: found {_OTHER_MODEL}, expected {_TAG}")
    name, *lines = lines
    name = name.strip()
    with errors_of(f"camera {name}"):
        if size_line is not None:
            size = numbers_of_line(size_line.split(), ("width", "height"))
            image_size = (as_count(size[0], "width"), as_count(size[1], "height"))
        if len(lines) != 7:
            raise ValueError(f"found {1 + len(lines)} lines, expected 8")
        words = [line.split() for line in lines]
        position, angles, (focal,), (xh, yh) = map(numbers_of_line, words, _LINES)
        terms = len(words[4])
        if terms not in _TERMS:
            raise ValueError(f"E: found {terms} terms, expected {' or '.join(map(str, _TERMS))}")
        names = [f"E{i}" for i in range(terms)]
        correction = np.array([numbers_of_line(row, names) for row in words[4:]])  # (3, terms)
        if focal == 0:
            raise ValueError("f: found 0, expected a focal length in pixels")
        width, height = required_size(image_size, "MyPTV")
        if correction.any():
            check_table_size((width, height))
            uv = pixel_centres((width, height))
            inner = (uv - [width / 2 + xh, height / 2 + yh]).T
            seen = np.concatenate([inner, np.full((1, len(uv)), focal)])  # (3, pixels)
            seen = seen + correction @ _polynomial(*uv.T)[:terms]
            directions = np.sign(focal) * seen.T @ matrix_of_angles(*angles)
            directions = directions.reshape(height, width, 3)
            return RayTable(name, position, directions, status="calibrated")
        # f < 0 turns the image by 180 degrees; points in front have a positive third coordinate
        sign = np.sign(focal)
        R = np.diag([sign, sign, 1.0]) @ matrix_of_angles(*angles)
        K = [
            [abs(focal), 0.0, width / 2 + xh],
            [0.0, abs(focal), height / 2 + yh],
            [0.0, 0.0, 1.0],
        ]
    return Camera(name, (width, height), K, R=R, t=-R @ position, status="calibrated")


def _polynomial(eta: NDArray[np.float64], zeta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terms Z ``(9, pixels)``."""
    quadratic = [eta, zeta, eta**2, zeta**2, eta * zeta]
    return np.stack([*quadratic, eta**3, eta**2 * zeta, eta * zeta**2, zeta**3])
