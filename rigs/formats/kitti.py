"""KITTI's ``calib_cam_to_cam.txt``, and the ``calib.txt`` of its odometry and object sets.

Read only. The first holds, for each camera ``00`` to ``03``, ``S`` the image size, ``K``, ``D``
(OpenCV's five coefficients) and ``R, T`` with ``x_cam = R @ x_cam0 + T``: cameras of the images as
taken, before rectification; a warning says so, as the sets named ``sync`` hold rectified images,
whose cameras are ``P_rect``. The others hold ``P0`` to ``P3`` alone, 3 x 4 projection matrices of
rectified images from the axes of camera 0; the image size is asked for. Lengths are in metres,
pixel centres at integers. Source: Geiger and others, "Vision meets robotics: the KITTI dataset"
(2013), and the development kit of https://www.cvlibs.net/datasets/kitti.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.files.text import read_text
from rigs.formats._lens import from_vector
from rigs.formats._values import as_array, as_rotation, as_size, errors_of, required, required_size
from rigs.formats.projection import camera_of_matrix
from rigs.rig import Rig

logger = logging.getLogger(__name__)


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has lines of cameras by their numbers."""
    keys = set(re.findall(r"^(\w+):", head, re.MULTILINE))
    return {"K_00", "D_00", "R_00", "T_00"} <= keys or {"P0", "P1", "P2", "P3"} <= keys


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a calibration's text."""
    lines = dict(re.findall(r"^(\w+):(.*)$", read_text(path), re.MULTILINE))
    numbers = [key[2:] for key in lines if re.fullmatch(r"K_\d+", key)]
    if numbers:
        cameras = tuple(_camera(number, lines) for number in numbers)
        logger.warning("%s: cameras of the images as taken: those of the rectified images "
                       "(P_rect) are another rig", path)  # fmt: skip
    else:
        size = required_size(image_size, "KITTI's rectified")
        keys = [key for key in lines if re.fullmatch(r"P\d+", key)]
        cameras = tuple(_rectified(key, lines, size) for key in keys)
    return Rig(cameras, "m", "camera 0's axes")


def _camera(number: str, lines: dict[str, str]) -> Camera:
    """Return the camera of the images as taken."""
    name = f"image_{number}"
    with errors_of(f"camera {name}"):
        size = as_size(_row(lines, f"S_{number}", 2), "S")
        K = _row(lines, f"K_{number}", 9).reshape(3, 3)
        lens = from_vector(_row(lines, f"D_{number}", 5), False, "D")
        R = as_rotation(_row(lines, f"R_{number}", 9).reshape(3, 3), "R")
        t = _row(lines, f"T_{number}", 3)
    return Camera(name, size, K, lens, R, t, status="calibrated")


def _rectified(key: str, lines: dict[str, str], size: tuple[int, int]) -> Camera:
    """Return the camera of a projection matrix."""
    with errors_of(f"camera {key}"):
        return camera_of_matrix(_row(lines, key, 12).reshape(3, 4), key, size)


def _row(lines: dict[str, str], key: str, count: int) -> NDArray[np.float64]:
    """Return the numbers of a line."""
    return as_array(required(lines, key).split(), (count,), key)
