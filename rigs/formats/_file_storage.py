"""Values from ``cv2.FileStorage`` files, under the names that different programs use.

The cameras of a ``cv2.FileStorage`` file: one, a list, a mapping, lists or numbered keys.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import read_json_mapping, read_text, shortened, some, yaml_mapping
from rigs.files.xml_file import read_xml
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_rotation,
    as_size,
    errors_of_file,
    flat,
    one_of,
)
from rigs.geometry.rotation import matrix_of_vector

SUFFIXES = (".yml", ".yaml", ".json", ".xml")
MATRIX = ("camera_matrix", "cameraMatrix", "intrinsic_matrix", "K", "M")
LENS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "distortion_coeffs", "D")
TURN, SHIFT = ("R", "rvec"), ("T", "tvec", "t")
#: ROS's and our names of lenses, and whether they are fisheyes.
_LENS_NAMES = {
    "plumb_bob": False,
    "rational_polynomial": False,
    "thin_prism": False,
    "pinhole": False,
    "equidistant": True,
    "fisheye": True,
}


def is_storage(head: str) -> bool:
    """Return whether a file is of ``cv2.FileStorage``, whatever its keys."""
    return bool(re.search(r"\A\s*%YAML:1|\bopencv-matrix\b|<opencv_storage", head))


def storage_files(folder: Path) -> list[Path]:
    """Return the files of a folder that may be of ``cv2.FileStorage``."""
    return sorted(p for p in folder.iterdir() if p.suffix in SUFFIXES and p.is_file())


def read_storage(path: Path) -> dict[str, Any]:
    """Return the plain data of a file, its matrices as mappings of rows, cols and data."""
    if path.suffix == ".json":
        return read_json_mapping(path)
    if path.suffix == ".xml":
        root = read_xml(path)
        if root.tag != "opencv_storage":
            raise ValueError(f"{path}: found XML of <{root.tag}>, expected <opencv_storage>")
        with errors_of_file(path):
            return _mapping(root)
    text = read_text(path)
    # OpenCV's directive has a colon too many for YAML, and its tags repeat what the keys say.
    text = re.sub(r"\A\s*%YAML:?\s*\d+\.\d+[^\n]*", "", text)
    return yaml_mapping(re.sub(r"(:\s|-\s|^)\s*!!opencv-[a-z-]+", r"\1", text), path)


def _mapping(element: Element) -> dict[str, Any]:
    """Return the data of an element's children by their names."""
    found: dict[str, Any] = {}
    for child in element:
        if child.tag in found:
            raise ValueError(f"{shortened(child.tag)}: found twice in one mapping")
        found[child.tag] = _data_of(child)
    return found


def _data_of(element: Element) -> Any:
    """Return an element's data: a matrix or mapping, a list of ``_``, or its text's values."""
    if len(element):
        return [_data_of(c) for c in element] if element[0].tag == "_" else _mapping(element)
    words = re.findall(r'"[^"]*"|\S+', element.text or "")
    values = [word[1:-1] if word[0] == '"' else _number_or_text(word) for word in words]
    if element.tag == "data":
        return values
    return None if not values else values[0] if len(values) == 1 else values


def _number_or_text(word: str) -> float | int | str:
    """Return a word's number, else the word."""
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word


def first(entry: Mapping[str, Any], keys: tuple[str, ...]) -> str | None:
    """Return the first of ``keys`` that is in the entry."""
    return next((key for key in keys if entry.get(key) is not None), None)


def _plain(found: object, what: str) -> object:
    """Return the rows of a matrix in OpenCV's form or as plain lists."""
    if not isinstance(found, dict):
        return found
    if found.get("sizes") is not None:
        data, sizes = (
            flat(found.get("data"), f"{what}.data"),
            flat(found["sizes"], f"{what}.sizes"),
        )
        if len(sizes) > 2 or np.prod(sizes) != len(data):
            raise ValueError(
                f"{what}.sizes: found {shortened(found['sizes'])} and {len(data)} numbers, "
                "expected one or two sizes of as many"
            )
        return data.reshape(sizes.astype(int))
    rows, columns = (as_count(found.get(key), f"{what}.{key}") for key in ("rows", "cols"))
    data = as_array(found.get("data"), (None,), f"{what}.data")
    if len(data) != rows * columns:
        raise ValueError(f"{what}.data: found {len(data)} numbers, expected {rows} x {columns}")
    return data.reshape(rows, columns)


def matrix(entry: Mapping[str, Any], keys: tuple[str, ...], shape: tuple[int, int]) -> NDArray:
    """Return the matrix under the first of ``keys``."""
    key = first(entry, keys)
    if key is None:
        raise ValueError(f"{keys[0]}: missing, expected {shape[0]} x {shape[1]} numbers")
    return as_array(_plain(entry[key], key), shape, key)


def vector(entry: Mapping[str, Any], keys: tuple[str, ...], count: int | None = None) -> NDArray:
    """Return the numbers under the first of ``keys``, a row, a column or a list."""
    key = first(entry, keys)
    if key is None:
        raise ValueError(f"{keys[0]}: missing, expected numbers")
    numbers = flat(_plain(entry[key], key), key)
    if count not in (None, len(numbers)):
        raise ValueError(f"{key}: found {len(numbers)} numbers, expected {count}")
    return numbers


def turn(entry: Mapping[str, Any]) -> NDArray:
    """Return the rotation of an entry, a matrix or OpenCV's rvec."""
    key = first(entry, TURN)
    values = vector(entry, TURN)
    if len(values) == 3:
        return matrix_of_vector(values)
    name = key or TURN[0]  # `vector` found one of them
    return as_rotation(values.reshape(3, 3) if len(values) == 9 else entry[name], name)


def size_of(entry: Mapping[str, Any]) -> tuple[int, int] | None:
    """Return the image size that an entry holds."""
    for keys in (("image_width", "image_height"), ("width", "height")):
        if entry.get(keys[0]) is not None:
            width, height = (as_count(entry.get(key), key) for key in keys)
            return width, height
    for key in ("image_size", "imageSize"):
        if entry.get(key) is not None:
            return as_size(flat(_plain(entry[key], key), key), key)
    return None


def is_fisheye(entry: Mapping[str, Any]) -> bool:
    """Return whether an entry's lens is a fisheye."""
    if entry.get("distortion_model") is not None:
        return _LENS_NAMES[one_of(entry["distortion_model"], _LENS_NAMES, "distortion_model")]
    return bool(entry.get("fisheye_model", False))


def by_suffix(data: Mapping[str, Any], stems: Mapping[str, str]) -> dict[str, dict[str, Any]]:
    """Return the entries of cameras whose fields are keys like ``K_left`` at the top level."""
    entries: dict[str, dict[str, Any]] = {}
    for key, value in data.items():
        for stem, field in stems.items():
            if key.startswith(f"{stem}_") and len(key) > len(stem) + 1 and value is not None:
                entries.setdefault(key[len(stem) + 1 :], {})[field] = value
                break
    return entries


def keys_found(data: Mapping[str, Any]) -> str:
    """Return the first keys of a mapping in words, for a message."""
    return some(" ".join(key.split())[:30] for key in data) or "no keys"


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
            raise ValueError(f"{key}: found {shortened(found)}, expected a list of {len(entries)}")
        shared = {k: data[k] for k in _SHARED if k in data}
        for entry, value in zip(entries.values(), found, strict=True):
            entry.update({**shared, keys[0]: value})
    return entries


def _is_nested(found: list) -> bool:
    """Return whether a list is one of lists."""
    return bool(found) and isinstance(found[0], list)
