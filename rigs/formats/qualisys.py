"""Qualisys Track Manager's calibration, ``.qca.txt`` or XML: its video cameras.

Read only. A ``camera`` has ``fov_video``, the first and the last column and row of the image;
``transform``, its position in millimetres and nine numbers ``r11 ... r33``; and ``intrinsic``,
focal lengths and principal point in 1/64 of a pixel of the whole sensor, and OpenCV's distortion
(radial 1 to 3, tangential 1 and 2) of points in focal lengths. Pixel centres are at integers. The
rows of ``r`` are the camera's axes in the world: x right, y up, z backwards.

Some programs write the transpose: it is read where axes meet in front of the cameras by it alone.
Sources:
https://docs.theiamarkerless.com/theia3d-documentation/data-formats/calibration-files;
``read_qca`` of ``Pose2Sim/calibration.py`` at https://github.com/perfanalytics/pose2sim, which
divides the distortion by 64 as well; it has no unit, and is taken as it is.
"""

from __future__ import annotations

import logging
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from rigs.camera import Camera
from rigs.files.xml_file import read_xml
from rigs.formats._lens import from_vector
from rigs.formats._values import as_count, as_number, as_rotation, errors_of, usable_name
from rigs.formats.projection import look_away
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
_LENS = (
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",
    "tangentalDistortion2",
    "radialDistortion3",
)


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is XML of a calibration with Qualisys's intrinsics."""
    return "<calibration" in head and "<fov_video" in head and "focalLengthU" in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``.qca.txt``."""
    root = read_xml(path)
    elements = root.findall("cameras/camera")
    active = [e for e in elements if e.get("active") != "0"]
    if not active:
        raise ValueError(f"cameras: found {len(elements)}, none active, expected some")
    names = [e.get("serial") or f"camera{i}" for i, e in enumerate(active, 1)]
    names = [usable_name(name, path) for name in names]
    pairs = list(zip(names, active, strict=True))
    cameras = tuple(_camera(name, element, by_rows=True) for name, element in pairs)
    if look_away(cameras) is not False:
        others = tuple(_camera(name, element, by_rows=False) for name, element in pairs)
        if look_away(others) is False:
            cameras = others
            logger.warning("%s: transform: r11 ... r33 are read as columns, not rows: by rows "
                           "the cameras' axes do not meet in front of them", path)  # fmt: skip
    turned = [name for name, e in pairs if e.get("viewrotation", "0") not in ("", "0")]
    for what, lost in (
        ("viewrotation: pixels are taken as on the sensor, not turned:", turned),
        ("left out cameras that are not active:", [e.get("serial") for e in elements
                                                   if e not in active]),
    ):  # fmt: skip
        if lost:
            logger.warning("%s: %s %s", path, what, ", ".join(map(str, lost)))
    return Rig(cameras, "mm", f"as in {path.name}")


def _camera(name: str, element: Element, by_rows: bool) -> Camera:
    """Return the camera of an element."""
    with errors_of(f"camera {name}"):
        left, top, right, bottom = (
            _number(element, "fov_video", key) for key in ("left", "top", "right", "bottom")
        )
        size = as_count(right - left + 1, "fov_video"), as_count(bottom - top + 1, "fov_video")
        fx, fy, u, v, skew = (
            _number(element, "intrinsic", key) / 64  # subpixels
            for key in ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "skew")
        )
        lens = from_vector(
            [_number(element, "intrinsic", key) for key in _LENS], False, "intrinsic"
        )
        turn = np.array(
            [[_number(element, "transform", f"r{i}{j}") for j in "123"] for i in "123"]
        )
        R = _TO_OPENCV @ as_rotation(turn if by_rows else turn.T, "transform")
        position = np.array([_number(element, "transform", key) for key in "xyz"])
        K = [[fx, skew, u - left], [0.0, fy, v - top], [0.0, 0.0, 1.0]]
    return Camera(name, size, K, lens, R, -R @ position, status="calibrated")


def _number(element: Element, child: str, key: str) -> float:
    """Return the number of a child's attribute; some are written only where they are not 0."""
    found = element.find(child)
    if found is None:
        raise ValueError(f"{child}: missing, expected it in each camera")
    default = "0" if key in (*_LENS, "skew") else None
    return as_number(found.get(key, default), f"{child} {key}")
