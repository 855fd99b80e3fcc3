"""EasyMocap's ``intri.yml`` and ``extri.yml``: OpenCV's cameras, one key a camera and field.

Read only. ``names``: the cameras; ``K_<name>`` 3 x 3, ``dist_<name>`` (or ``D_<name>``) in
OpenCV's order, ``H_<name>, W_<name>`` the image size, which older files lack; ``R_<name>`` the
rotation vector, ``Rot_<name>`` its matrix, ``T_<name>``. ``x_cam = R @ x_world + T``, pixel
centres at integers; lengths are in the unit of the board, which the files do not name. Both
halves may stand in one file, in YAML, JSON or XML, and ``names`` may be absent.
Source: ``easymocap/mytools/camera_utils.py`` at https://github.com/zju3dv/EasyMocap.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.files.text import shortened
from rigs.files.units import UNKNOWN
from rigs.formats._file_storage import (
    SUFFIXES,
    by_suffix,
    keys_found,
    matrix,
    read_storage,
    storage_files,
    turn,
    vector,
)
from rigs.formats._lens import from_vector
from rigs.formats._values import RIGID, as_count, errors_of, read_head, required_size
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_STEMS = {"K": "K", "dist": "D", "D": "D", "W": "W", "H": "H", "R": "R", "Rot": "Rot", "T": "T"}
_KEY = re.compile(r'(?:^|[\s{,<])"?(?:K|R|Rot)_[\w.-]+(?:"?\s*:|\s+type_id|>)')


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file, or one in a folder, has keys like ``K_<name>`` or ``R_<name>``."""
    if path.is_dir():
        return bool(_files_of(path))
    return path.suffix in SUFFIXES and bool(_KEY.search(head))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of the folder of the two files, of one of them, or of a file of both."""
    files = _files_of(path) if path.is_dir() else [path, *_partner(path)]
    data: dict[str, Any] = {}
    for file in files:
        for key, value in read_storage(file).items():
            if key in data and key != "names" and path.is_dir():
                raise ValueError(f"{path}: {key}: found in two files, expected one of them alone")
            data.setdefault(key, value)
    entries = by_suffix(data, _STEMS)
    names = _names(data.get("names"), entries)
    if not any("K" in entry for entry in entries.values()):
        raise ValueError(
            f"K_<camera>: missing, found {keys_found(data)}, expected K_<camera> here or in "
            "intri.yml beside it"
        )
    has_poses = any(entry.keys() & {"R", "Rot"} for entry in entries.values())
    cameras = [_camera(n, entries.get(n, {}), has_poses, image_size) for n in names]
    if not has_poses:
        logger.warning("%s: no poses (R_<camera>, T_<camera>) in it or in extri.yml beside "
                       "it: all cameras stand at the origin", path)  # fmt: skip
    world = f"as in {path.name}" if has_poses else "none: every camera stands at the origin"
    return Rig(tuple(cameras), UNKNOWN, world)


def _names(found: object, entries: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the names that the file lists, else those of the intrinsics."""
    if found is not None and not isinstance(found, list):
        raise ValueError(f"names: found {shortened(found)}, expected a list of the cameras")
    listed = [str(name) for name in found or ()]
    return listed or [name for name, entry in entries.items() if "K" in entry]


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder that have such keys."""
    return [file for file in storage_files(folder) if _KEY.search(read_head(file))]


def _partner(path: Path) -> list[Path]:
    """Return the file beside ``path`` of the other half, if it is there."""
    other = {"intri": "extri", "extri": "intri"}
    stem = re.sub("intri|extri", lambda m: other[m[0]], path.stem, count=1)
    partner = path.with_name(stem + path.suffix)
    return [partner] if stem != path.stem and partner.is_file() else []


def _camera(
    name: str, entry: Mapping[str, Any], has_poses: bool, image_size: tuple[int, int] | None
) -> Camera:
    """Return a camera by its fields."""
    named = {f"{field}_{name}": value for field, value in entry.items()}
    with errors_of(f"camera {name}"):
        K = matrix(named, (f"K_{name}",), (3, 3))
        if "D" not in entry:
            raise ValueError(f"dist_{name}: missing, expected 4 or more numbers, if only zeros")
        distortion = from_vector(vector(named, (f"D_{name}",)), False, f"dist_{name}")
        if entry.keys() & {"W", "H"}:
            size = tuple(as_count(entry.get(key), f"{key}_{name}") for key in ("W", "H"))
        else:
            size = required_size(image_size, "older EasyMocap")
        R, t = np.eye(3), np.zeros(3)
        if has_poses:
            R, t = _rotation(entry, name), vector(named, (f"T_{name}",), 3)
        status = "calibrated" if has_poses else "nominal"
    return Camera(name, size, K, distortion, R, t, status=status)


def _rotation(entry: Mapping[str, Any], name: str) -> NDArray[np.float64]:
    """Return the rotation of ``R_<name>``, which EasyMocap uses, or ``Rot_<name>``."""
    found = [turn({"R": entry[key]}) for key in ("R", "Rot") if key in entry]
    if not found:
        raise ValueError(f"R_{name}: missing, expected it as other cameras have one")
    if np.abs(found[0] - found[-1]).max() > RIGID:
        raise ValueError(f"Rot_{name}: found another rotation than R_{name}, expected the same")
    return found[0]
