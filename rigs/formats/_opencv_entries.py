"""The cameras of a ``cv2.FileStorage`` file: one, a list, a mapping, lists or numbered keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rigs.files.text import shortened
from rigs.formats._file_storage import LENS, MATRIX, SHIFT, TURN, by_suffix, first, keys_found
from rigs.formats._values import as_mapping

#: Names of lists, one item a camera, beside the names of single values.
PLURALS = {
    MATRIX: ("camera_matrices", "cameraMatrices", "intrinsic_matrices", "Ks"),
    LENS: ("dist_coeffs_list", "distCoeffsList", "Ds"),
    TURN: ("rvecs", "Rs"),
    SHIFT: ("tvecs", "Ts"),
}
#: Fields that one value of a file gives for all cameras of its lists.
_SHARED = ("image_width", "image_height", "image_size", "imageSize", "fisheye_model")
_NUMBERED = {"camera_matrix": "K", "camera_distortion": "D", "camera_pose": "pose", "xi": "xi"}


def has_cameras(data: Mapping[str, Any]) -> bool:
    """Return whether the data of a file in a folder are, or hold, cameras."""
    keys = (*MATRIX, *PLURALS[MATRIX], "camera_matrix_0", "cameras")
    inner = (value for value in data.values() if isinstance(value, dict))
    return first(data, keys) is not None or any(first(value, MATRIX) for value in inner)


def entries_of(data: dict[str, Any], stem: str) -> dict[str, dict[str, Any]]:
    """Return the entries of the cameras in a file by name."""
    lists = _of_lists(data)
    if lists:
        return lists
    if first(data, MATRIX) is not None:
        name = data.get("name", data.get("camera_name", stem))
        return {name if isinstance(name, str) else str(name): data}
    found = data.get("cameras", data)
    if isinstance(found, list):
        entries = {}
        for index, item in enumerate(found):
            entry = as_mapping(item, f"cameras[{index}]")
            name = str(entry.get("name", f"camera{index}"))
            if name in entries:
                raise ValueError(f"camera {name}: name: found twice, expected once in a rig")
            entries[name] = entry
    elif found is data and "camera_matrix_0" in data:
        entries = {f"camera_{k}": v for k, v in by_suffix(data, _NUMBERED).items() if "K" in v}
    elif found is data:
        entries = {k: v for k, v in data.items() if isinstance(v, dict) and first(v, MATRIX)}
    else:
        entries = {
            k: as_mapping(v, f"camera {k}") for k, v in as_mapping(found, "cameras").items()
        }
    if not entries:
        raise ValueError(
            f"camera_matrix: missing, found {keys_found(data)}, expected camera_matrix (or "
            "cameraMatrix, intrinsic_matrix, K, M) and distortion_coefficients, a list cameras of "
            "them, or EasyMocap's K_<camera>, R_<camera>, T_<camera>"
        )
    return entries


def _of_lists(data: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the entries of cameras whose fields are lists of one length, or nothing."""
    entries: dict[str, dict[str, Any]] = {}
    for keys in (MATRIX, LENS, TURN, SHIFT):
        key = first(data, (*keys, *PLURALS[keys]))
        if key is None or (keys is not MATRIX and not entries):
            continue
        found = data[key]
        is_list = isinstance(found, list) and found and isinstance(found[0], (dict, list))
        if keys is MATRIX:
            if not is_list or (isinstance(found[0], list) and not _is_nested(found[0])):
                return {}  # one matrix
            entries = {f"camera{i}": {} for i in range(len(found))}
        elif not is_list or len(found) != len(entries):
            raise ValueError(
                f"{key}: found {shortened(found)}, expected a list of {len(entries)}, one a camera"
            )
        shared = {k: data[k] for k in _SHARED if k in data}
        for entry, value in zip(entries.values(), found, strict=True):
            entry.update({**shared, keys[0]: value})
    return entries


def _is_nested(found: list) -> bool:
    """Return whether a list is one of lists."""
    return bool(found) and isinstance(found[0], list)
