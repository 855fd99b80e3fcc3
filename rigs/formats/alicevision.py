"""AliceVision's and Meshroom's ``.sfm`` or JSON: views, intrinsics and poses, numbers as text.

A pose's ``rotation`` is world to camera, OpenCV's axes, nine numbers *column by
column*; ``center`` is the camera's. ``fx = focalLength / sensorWidth * width`` pixels;
``fy = fx pixelRatio`` since version 1.2.5 of the format, ``fx / pixelRatio`` before; older files
have ``pxFocalLength``. The principal point is from the image's middle in pixels (before 1.2.1 from
its corner), (0.5, 0.5) the centre of the top-left pixel. Lenses are ``type``, or since 1.2.6
``distortionType``. Views with their rig's pose alone are refused. Sources:
``src/aliceVision/sfmDataIO/jsonIO.cpp`` and ``src/aliceVision/camera`` at
https://github.com/alicevision/AliceVision.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_json_mapping, shortened
from rigs.formats._lens import from_vector
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    as_rotation,
    errors_of,
    flat,
    required,
)
from rigs.formats._views import Views
from rigs.rig import Rig

#: Places of OpenCV's coefficients in the file's by the lens's name; None stands for 0.
_LENSES: dict[str, tuple[int | None, ...]] = {
    "pinhole": (),
    "none": (),
    "radial1": (0, None, None, None),
    "radialk1": (0, None, None, None),
    "radial3": (0, 1, None, None, 2),
    "radialk3": (0, 1, None, None, 2),
    "brown": (0, 1, 3, 4, 2),
    "fisheye4": (0, 1, 2, 3),
    "fisheye": (0, 1, 2, 3),
}


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has AliceVision's views."""
    return path.suffix in (".sfm", ".json") and '"viewId"' in head and '"intrinsicId"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``.sfm`` after a reconstruction."""
    data = read_json_mapping(path)
    version = tuple(flat(data.get("version", ()), "version").tolist())
    lenses, poses = _by(data, "intrinsics", "intrinsicId"), _by(data, "poses", "poseId")
    views = Views(path)
    for number, view in _by(data, "views", "viewId").items():
        name = view.get("path")
        with errors_of(f"view {number}"):
            if not isinstance(name, str):
                raise ValueError(f"path: found {shortened(name)}, expected an image's name")
            if view.get("isPoseIndependant", "true") not in ("true", "1", True):
                found = shortened(view["isPoseIndependant"])
                raise ValueError(f"isPoseIndependant: found {found}, expected a pose of its "
                                 "own, not its rig's")  # fmt: skip
            lens, pose = (str(view.get(key)) for key in ("intrinsicId", "poseId"))
            if pose not in poses or lens not in lenses:
                views.lost.append(name or number)
                continue
            camera = _camera(lenses[lens], poses[pose], version)
            views.add(name or number, camera, lens)
    with errors_of("poses"):
        return views.rig()


def _by(data: Mapping[str, Any], key: str, identity: str) -> dict[str, dict[str, Any]]:
    """Return the entries of a list by their numbers; an empty list may be an empty text."""
    found = data.get(key) or []
    if not isinstance(found, list):
        raise ValueError(f"{key}: found {shortened(found)}, expected a list")
    entries = [as_mapping(entry, f"{key}[{i}]") for i, entry in enumerate(found)]
    return {str(required(entry, identity)): entry for entry in entries}


def _camera(entry: Mapping[str, Any], pose: Mapping[str, Any], version: tuple) -> Camera:
    """Return the camera of a view, under a placeholder name."""
    with errors_of(f"intrinsics {entry['intrinsicId']}"):
        width, height = (as_count(required(entry, side), side) for side in ("width", "height"))
        fx, fy = _focal_lengths(entry, width, version)
        center = _pair(required(entry, "principalPoint"), "principalPoint")
        if version >= (1, 2, 1):
            center = np.add(center, (width / 2, height / 2))
        lens = _lens(entry)
    with errors_of(f"pose {pose['poseId']}"):
        motion = as_mapping(required(pose, "pose"), "pose")
        motion = as_mapping(required(motion, "transform"), "transform")
        turn = as_array(required(motion, "rotation"), (9,), "rotation").reshape(3, 3)
        R = as_rotation(turn.T, "rotation")
        position = as_array(required(motion, "center"), (3,), "center")
    K = [[fx, 0.0, center[0] - 0.5], [0.0, fy, center[1] - 0.5], [0.0, 0.0, 1.0]]
    return Camera("view", (width, height), K, lens, R, -R @ position, status="calibrated")


def _focal_lengths(entry: Mapping[str, Any], width: int, version: tuple) -> tuple[float, float]:
    """Return the focal lengths in pixels."""
    if version < (1, 2, 2):
        found = flat(required(entry, "pxFocalLength"), "pxFocalLength")
        return float(found[0]), float(found[-1])
    sensor = as_number(entry.get("sensorWidth", 36.0), "sensorWidth")
    ratio = as_number(entry.get("pixelRatio", 1.0), "pixelRatio")
    if not sensor > 0 or not ratio > 0:
        raise ValueError(f"sensorWidth, pixelRatio: found {sensor} and {ratio}, expected above 0")
    fx = as_number(required(entry, "focalLength"), "focalLength") / sensor * width
    return fx, fx * ratio if version >= (1, 2, 5) else fx / ratio


def _pair(found: object, what: str) -> np.ndarray:
    """Return two numbers, of a list or of ``x`` and ``y`` as in Meshroom's projects."""
    return as_array(list(found.values()) if isinstance(found, dict) else found, (2,), what)


def _lens(entry: Mapping[str, Any]) -> Any:
    """Return the lens of an intrinsic."""
    kind, bent = entry.get("type"), entry.get("distortionType", "none")
    straightened = entry.get("undistortionParams") or entry.get("undistortionType", "none")
    name = bent if kind == "pinhole" and bent != "none" else kind
    if not isinstance(name, str) or name not in _LENSES or straightened != "none":
        raise ValueError(
            f"type: found {shortened(name)}, undistorted by {shortened(straightened)}, expected "
            f"one of {', '.join(_LENSES)}, undistorted by 'none'"
        )
    places = _LENSES[name]
    count = 1 + max((place for place in places if place is not None), default=-1)
    values = flat(entry.get("distortionParams") or [0.0] * count, "distortionParams")
    if places and len(values) != count:
        raise ValueError(f"distortionParams: found {len(values)} numbers, expected {count}")
    coefficients = [0.0 if place is None else values[place] for place in places]
    return from_vector(coefficients, name.startswith("fisheye"), "distortionParams")
