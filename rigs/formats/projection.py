"""Projection matrices: text files of three rows of four numbers, one camera each, or a folder.

Read only. ``P (X, 1)`` is the pixel's ``(u w, v w, w)``; pixel centres are taken at integers, rows
from the top. PMVS's files, with ``CONTOUR`` in the first line, and DTU's ``pos_001.txt`` are such
files. The camera is named by its file. There is no distortion and no unit. The files hold no image
size: it is that of the image of the same name beside them or in PMVS's ``../visualize``, else it
is asked for. Source: documentation of PMVS-2, https://www.di.ens.fr/pmvs/documentation.html;
README of the DTU sets, https://roboimagedata.compute.dtu.dk.

Cameras of projection matrices ``(3, 4)``: the pixel of X is ``P (X, 1)`` over its depth.

``P = s K [R | t]`` up to a factor: the left 3 x 3 block is an upper triangular matrix times a
rotation, its sign that of a positive determinant, so that points in front have a positive depth.
Source: Hartley and Zisserman, "Multiple View Geometry" (2003), section 6.2.4.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import read_text
from rigs.files.units import UNKNOWN
from rigs.formats._values import (
    cameras_of,
    errors_of,
    image_beside,
    numbers_of_line,
    read_head,
    required_size,
)
from rigs.geometry.points import nearest_point
from rigs.geometry.rotation import upper_times_rotation
from rigs.rig import Rig

_MOST_RESIDUAL = (
    1e-6  # pixels between P and its K, R, t; rounding of a sane matrix stays far below
)
_LEAST_PARALLAX = 1e-3  # eigenvalue a camera, radians squared: axes nearer to parallel do not meet


def camera_of_matrix(P: NDArray[np.float64], name: str, image_size: tuple[int, int]) -> Camera:
    """Return the pinhole that projects like ``P`` ``(3, 4)``."""
    with np.errstate(all="ignore"):
        scaled = P / np.linalg.norm(P[2, :3])
        regular = np.isfinite(scaled).all() and np.linalg.cond(scaled[:, :3]) < 1e14
    if not regular:
        raise ValueError(
            "P: found a left 3 x 3 block that is singular, expected one of rank 3: a camera with "
            "a centre"
        )
    if np.linalg.det(scaled[:, :3]) < 0:
        scaled = -scaled
    K, R = upper_times_rotation(scaled[:, :3])
    if np.abs(K - np.eye(3)).max() < 1e-3:
        raise ValueError("P: found a pose [R | t], expected K [R | t]: the focal length is 1 px")
    t = np.linalg.solve(K, scaled[:, 3])
    camera = Camera(name, image_size, K / K[2, 2] + 0.0, R=R, t=t / K[2, 2], status="calibrated")
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * np.array(image_size, np.float64)
    origins, directions = camera.rays(corners)
    points = origins + directions * max(1.0, float(np.linalg.norm(camera.t)))
    image = np.c_[points, np.ones(4)] @ scaled.T
    residual = float(np.abs(image[:, :2] / image[:, 2:] - corners).max())
    if not residual <= _MOST_RESIDUAL:
        raise ValueError(
            f"P: found K, R, t that project {residual:.2g} px from it, expected {_MOST_RESIDUAL} "
            f"px, which a focal length of {camera.camera_matrix[0, 0]:.2g} px leaves no digits for"
        )
    return camera


def look_away(cameras: Sequence[CameraLike]) -> bool | None:
    """Return whether the point where the axes meet lies behind the cameras; None if undecided.

    It does where a matrix's rows count from the image's bottom: mirrored images turn a camera
    round. Undecided are single cameras, parallel axes, and points in front of some of them only.
    """
    positions = np.array([camera.position for camera in cameras])
    axes = np.array([camera.R[2] for camera in cameras])
    point, certainty = nearest_point(positions, axes)
    if certainty < _LEAST_PARALLAX * len(cameras):
        return None
    in_front = np.sum((point - positions) * axes, axis=1) > 0
    return None if in_front.any() and not in_front.all() else not in_front.any()


_ENDINGS = (".txt", ".dat", ".csv", ".p", ".proj")  # of files in a folder that are looked into
_NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
_BETWEEN = r"(?:[^\S\n]*+[,;][^\S\n]*+|[^\S\n]++)"
_ROW = rf"[^\S\n]*+{_NUMBER}(?:{_BETWEEN}{_NUMBER}){{3}}[^\S\n]*+"
_MATRIX = re.compile(rf"\s*+(?:CONTOUR[^\S\n]*+\n\s*+)?{_ROW}\n{_ROW}\n{_ROW}\s*+")
_NAMES = [f"P{row}{column}" for row in "123" for column in "1234"]


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is one matrix, or a folder holds such files."""
    if path.is_dir():
        return bool(_files_of(path))
    return _MATRIX.fullmatch(head) is not None


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a matrix's file, or of a folder of them."""
    what = "files of 3 x 4 numbers, expected one a camera"
    cameras = cameras_of(path, _files_of, lambda file: _camera(file, image_size), what)
    if look_away(cameras):
        raise ValueError(
            "P: found cameras that look away from the point where their axes meet, expected "
            "rows that count from the top of the image"
        )
    return Rig(cameras, UNKNOWN, f"as in {path.name}")


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder that are matrices."""
    files = [file for file in sorted(folder.iterdir()) if file.suffix.lower() in _ENDINGS]
    return [file for file in files if file.is_file() and _MATRIX.fullmatch(read_head(file))]


def _camera(file: Path, image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of a file."""
    words = re.split(r"\s*[,;]\s*|\s+", read_text(file).strip().removeprefix("CONTOUR").strip())
    with errors_of(f"camera {file.stem}"):
        P = np.array(numbers_of_line(words, _NAMES)).reshape(3, 4)
        folders = (file.parent, file.parent.parent / "visualize")
        size = required_size(image_size, "projection matrix", image_beside(folders, file.stem))
        return camera_of_matrix(P, file.stem, size)
