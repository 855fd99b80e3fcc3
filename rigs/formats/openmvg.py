"""openMVG's ``sfm_data.json``: views, intrinsics and poses, with or without a structure.

Read only. ``x_cam = rotation @ (x_world - center)``, OpenCV's axes. Intrinsics have one
``focal_length`` and a ``principal_point`` in pixels whose centres are at integers (openMVG's own
resampling of images takes column and row as they are). Known are pinhole, pinhole_radial_k1,
pinhole_radial_k3 (``disto_k3``: k1 k2 k3), pinhole_brown_t2 (``disto_t2``: k1 k2 k3 t1 t2, where
t1, t2 are OpenCV's p1, p2) and fisheye (``fisheye``: k1 to k4, OpenCV's); others, like spherical,
are refused by name. Lengths have no unit. A view's camera is its image's folder, else the image
itself, as in ``transforms.json``. Views without a pose, which openMVG could not place, are left
out with a warning. Source: ``src/openMVG/cameras`` and ``src/openMVG/sfm/sfm_data_io_cereal.cpp``
at https://github.com/openMVG/openMVG.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.files.text import read_json_mapping, shortened
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    as_rotation,
    errors_of,
    errors_of_file,
    one_of,
    required,
)
from rigs.formats._views import Views
from rigs.lens import Distortion
from rigs.rig import Rig

#: Key of the coefficients in the file, our model, and the places of its coefficients in them.
_MODELS: dict[str, tuple[str, str, tuple[int | None, ...]]] = {
    "pinhole": ("", "none", ()),
    "pinhole_radial_k1": ("disto_k1", "brown", (0, None, None, None)),
    "pinhole_radial_k3": ("disto_k3", "brown", (0, 1, None, None, 2)),
    "pinhole_brown_t2": ("disto_t2", "brown", (0, 1, 3, 4, 2)),
    "fisheye": ("fisheye", "fisheye", (0, 1, 2, 3)),
}
_FIELDS = {
    "image_size": "width, height",
    "distortion": "intrinsics",
    "camera_matrix": "intrinsics",
    "R": "rotation",
    "t": "center",
}
_NO_ID = 2**32 - 1  # openMVG's "undefined index"
_NAMED = 2**31  # cereal's bit of a type's first mention, which alone names it


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has the version of an openMVG scene."""
    return path.suffix == ".json" and '"sfm_data_version"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``sfm_data.json`` after a reconstruction.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    data = read_json_mapping(path)
    with errors_of_file(path):
        lenses = _intrinsics(_items(data, "intrinsics"))
        poses = dict(_items(data, "extrinsics"))
        views = Views(path, _FIELDS)
        for _, value in _items(data, "views"):
            view = _data(value, "views")
            name = f"{view.get('local_path') or ''}/{view.get('filename')}"
            image = name.replace("\\", "/").lstrip("/")
            with errors_of(f"view {image}"):
                pose, lens = (_identity(view, key) for key in ("id_pose", "id_intrinsic"))
            if pose not in poses or lens == _NO_ID:
                views.lost.append(image)
                continue
            with errors_of(f"view {image}"):
                if lens not in lenses:
                    raise ValueError(f"id_intrinsic: found {shortened(lens)}, expected one listed")
                views.add(image, _posed(lenses[lens], poses[pose]), lens)
        with errors_of("extrinsics"):
            return views.rig()


def _items(data: Mapping[str, Any], key: str) -> list[tuple[int, Any]]:
    """Return cereal's list of keys and values."""
    found = required(data, key)
    if not isinstance(found, list):
        raise ValueError(f"{key}: found {shortened(found)}, expected a list of keys and values")
    items = []
    for index, item in enumerate(found):
        with errors_of(f"{key}[{index}]"):
            item = as_mapping(item, "entry")
            items.append((_identity(item, "key"), required(item, "value")))
    return items


def _identity(values: Mapping[str, Any], key: str) -> int:
    """Return the number that names a view, a pose or an intrinsic."""
    number = required(values, key)
    if not isinstance(number, int) or isinstance(number, bool):
        raise ValueError(f"{key}: found {shortened(number)}, expected a whole number")
    return number


def _data(value: object, what: str) -> dict[str, Any]:
    """Return the members of a pointer to an object, with those of its base class."""
    pointer = as_mapping(required(as_mapping(value, what), "ptr_wrapper"), "ptr_wrapper")
    data = as_mapping(required(pointer, "data"), "data")
    base = data.get("value0")  # cereal's name of a base class without one
    return {**base, **data} if isinstance(base, dict) else data


def _intrinsics(items: list[tuple[int, Any]]) -> dict[int, Camera]:
    """Return the lenses by their number, as cameras without their poses."""
    kinds: dict[int, str] = {}
    found = {}
    for number, value in items:
        with errors_of(f"intrinsics {number}"):
            value = as_mapping(value, "value")
            identity, kind = value.get("polymorphic_id"), value.get("polymorphic_name")
            if isinstance(identity, int):
                kind = kinds.setdefault(identity % _NAMED, kind) if kind else kinds.get(identity)
            kind = one_of(kind, _MODELS, "polymorphic_name")
            found[number] = _lens(kind, _data(value, "value"))
    return found


def _lens(kind: str, data: Mapping[str, Any]) -> Camera:
    """Return the camera of one intrinsic at the origin."""
    focal = as_number(required(data, "focal_length"), "focal_length")
    cx, cy = as_array(required(data, "principal_point"), (2,), "principal_point")
    size = tuple(as_count(required(data, key), key) for key in ("width", "height"))
    key, model, places = _MODELS[kind]
    distortion = Distortion()
    if key:
        count = 1 + max(place for place in places if place is not None)
        values = as_array(required(data, key), (count,), key)
        coefficients = tuple(0.0 if place is None else values[place] for place in places)
        if any(coefficients) or model == "fisheye":
            distortion = Distortion(model, coefficients)
    K = [[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]]
    return Camera("intrinsic", size, K, distortion, status="calibrated")


def _posed(camera: Camera, found: object) -> Camera:
    """Return a camera at one of the poses."""
    pose = as_mapping(found, "pose")
    R: NDArray[np.float64] = as_rotation(required(pose, "rotation"), "rotation")
    center = as_array(required(pose, "center"), (3,), "center")
    return Camera("view", camera.image_size, camera.camera_matrix, camera.distortion, R,
                  -R @ center, status="calibrated")  # fmt: skip
