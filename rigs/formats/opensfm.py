"""OpenSfM's and ODM's ``reconstruction.json``: cameras, and shots with their poses.

A shot's ``rotation`` (a vector as OpenCV's rvec) and ``translation`` lead from the
world to the camera in OpenCV's axes. A camera's focal lengths and principal point are in units of
the longer side of the image, from its middle: pixel ``u = x max(w, h) + (w - 1) / 2`` with pixel
centres at integers. Known are perspective, simple_radial, radial, brown (OpenCV's lens), fisheye
and fisheye_opencv (OpenCV's fisheye); dual, spherical, fisheye62 and fisheye624 are refused. A
shot's camera is its image's folder, else the image itself, as in ``transforms.json``. Lengths are
metres where there is a geographic reference. Of several reconstructions, which have no common
axes, the first is read, and a warning names the others.
Source: ``doc/source/geometry.rst`` at https://github.com/mapillary/OpenSfM.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rigs.camera import Camera
from rigs.files.text import read_json, shortened
from rigs.files.units import UNKNOWN
from rigs.formats._lens import from_vector
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    errors_of,
    one_of,
    required,
)
from rigs.formats._views import Views
from rigs.geometry.rotation import matrix_of_vector
from rigs.rig import Rig

logger = logging.getLogger(__name__)

#: Coefficients of each model in OpenCV's order; None stands for 0.
_MODELS: dict[str, tuple[str | None, ...]] = {
    "perspective": ("k1", "k2", None, None),
    "simple_radial": ("k1", None, None, None),
    "radial": ("k1", "k2", None, None),
    "brown": ("k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("k1", "k2", None, None),
    "fisheye_opencv": ("k1", "k2", "k3", "k4"),
}
_COEFFICIENTS = {"k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"}


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file has OpenSfM's cameras."""
    return path.suffix == ".json" and '"projection_type"' in head and '"cameras"' in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``reconstruction.json``."""
    data = read_json(path)
    if not isinstance(data, list) or not data:
        raise ValueError(f"found {shortened(data)}, expected a list of reconstructions")
    if len(data) > 1:
        logger.warning("%s: %d further reconstructions are left out", path, len(data) - 1)
    scene = as_mapping(data[0], "reconstruction")
    lenses = as_mapping(required(scene, "cameras"), "cameras")
    views = Views(path)
    for name, shot in as_mapping(required(scene, "shots"), "shots").items():
        with errors_of(f"shot {name}"):
            shot = as_mapping(shot, "entry")
            key = required(shot, "camera")
            if not isinstance(key, str) or key not in lenses:
                raise ValueError(f"camera: found {shortened(key)}, expected one of cameras")
            views.add(name, _camera(key, lenses[key], shot), key)
    return views.rig("m" if "reference_lla" in scene else UNKNOWN)


def _camera(key: str, entry: object, shot: Mapping[str, Any]) -> Camera:
    """Return the camera of a shot, under a placeholder name."""
    with errors_of(f"camera {key}"):
        entry = as_mapping(entry, "entry")
        kind = one_of(required(entry, "projection_type"), _MODELS, "projection_type")
        for key in sorted(entry.keys() & _COEFFICIENTS - set(_MODELS[kind])):
            if as_number(entry[key], key) != 0:
                raise ValueError(f"{key}: found {entry[key]}, expected 0 for {kind}")
        values = [0.0 if k is None else as_number(entry.get(k, 0.0), k) for k in _MODELS[kind]]
        lens = from_vector(values, kind.startswith("fisheye"), "camera")
        width, height = (as_count(required(entry, side), side) for side in ("width", "height"))
        longer = max(width, height)
        fx, fy = (
            as_number(entry[k] if k in entry else required(entry, "focal"), k) * longer
            for k in ("focal_x", "focal_y")
        )
        cx, cy = (as_number(entry.get(k, 0.0), k) * longer for k in ("c_x", "c_y"))
        K = [[fx, 0.0, cx + (width - 1) / 2], [0.0, fy, cy + (height - 1) / 2], [0.0, 0.0, 1.0]]
    R = matrix_of_vector(as_array(required(shot, "rotation"), (3,), "rotation"))
    t = as_array(required(shot, "translation"), (3,), "translation")
    return Camera("shot", (width, height), K, lens, R, t, status="calibrated")
