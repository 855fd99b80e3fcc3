"""A cache of detections in one file, so that each image is searched once."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect.found import Found
from rigs.calibrate.detect.image_sets import MosaicImage, Source, VideoFrame
from rigs.files import atomic_path
from rigs.files.size_guard import errors_of_libraries, read_arrays

_FORMAT = "target detections 1"  # a new number when the search's results change
_FIELDS = ("format", "keys", "counts", "point", "uv", "blur", "reason", "legacy", "size")

Entry = tuple[Found, tuple[int, int]]
"""The detection, and the image's width and height."""


def key(target: str, camera: str, frame: str, source: Source) -> str:
    """Return a text that changes when the target or the image does."""
    if isinstance(source, np.ndarray):
        content = np.ascontiguousarray(source)
        digest = hashlib.sha256(content.tobytes()).hexdigest()
        identity = f"{content.dtype} {content.shape} {digest}"
    else:
        path = Path(source.path if isinstance(source, VideoFrame | MosaicImage) else source)
        try:
            state = path.stat()
        except OSError as error:
            raise ValueError(
                f"camera {camera}: {path}: cannot be read: {error.strerror}"
            ) from None
        identity = f"{path.absolute()} {state.st_size} {state.st_mtime_ns}"
        if isinstance(source, VideoFrame):
            identity += f" {source.index}"
        elif isinstance(source, MosaicImage):
            identity += " mosaic"
    return "\n".join((target, camera, frame, identity))


def read(path: Path) -> dict[str, Entry]:
    """Return the entries of the cache at ``path``, none if there is no such file.

    Raises
    ------
    ValueError
        If the file is of another kind; it is not overwritten.
    """
    if not path.exists():
        return {}
    kind = f"{path}: found another kind of file, expected a cache of detections or none"
    with errors_of_libraries(kind):
        stored = read_arrays(path)
        if str(stored["format"]) != _FORMAT:
            return {}
        return _entries(stored)


def _entries(stored: Mapping[str, NDArray]) -> dict[str, Entry]:
    """Return the entries of the arrays of a cache."""
    point, uv, size = (_numbers(stored[name]) for name in ("point", "uv", "size"))
    ends = np.cumsum(stored["counts"])
    if min(stored["counts"], default=0) < 0 or point.shape != (ends[-1] if len(ends) else 0,):
        raise ValueError("counts: found a sum that differs from the number of points")
    if uv.shape != (len(point), 2) or size.shape != (len(stored["keys"]), 2):
        raise ValueError(f"uv, size: found {uv.shape} and {size.shape}")
    if any(len(stored[name]) != len(size) for name in ("counts", "blur", "reason", "legacy")):
        raise ValueError("keys: found another number than of images")
    if not np.isfinite(uv).all() or (size < 1).any():
        raise ValueError("uv, size: found NaN, infinity or nothing")
    entries = {}
    for k, name in enumerate(stored["keys"].tolist()):
        rows = slice(int(ends[k] - stored["counts"][k]), int(ends[k]))
        legacy = {-1: None, 0: False, 1: True}[int(stored["legacy"][k])]
        blur, reason = float(stored["blur"][k]), str(stored["reason"][k])
        found = Found(point[rows].astype(np.int64), uv[rows].astype(float), blur, reason, legacy)
        entries[str(name)] = found, (int(size[k, 0]), int(size[k, 1]))
    return entries


def _numbers(array: NDArray) -> NDArray:
    if array.dtype.kind not in "iuf":
        raise ValueError(f"found {array.dtype}, expected numbers")
    return array


def write(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write the entries under a temporary name in the same folder, then rename it."""
    found = [entry[0] for entry in entries.values()]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            format=np.array(_FORMAT),
            keys=np.array(list(entries), dtype=np.str_),
            counts=np.array([len(item.point) for item in found], np.int64),
            point=np.concatenate([np.zeros(0, np.int64), *(item.point for item in found)]),
            uv=np.concatenate([np.zeros((0, 2)), *(item.uv for item in found)]),
            blur=np.array([item.blur for item in found], np.float64),
            reason=np.array([item.reason for item in found], dtype=np.str_),
            legacy=np.array([-1 if i.legacy is None else int(i.legacy) for i in found], np.int64),
            size=np.array([entry[1] for entry in entries.values()], np.int64).reshape(-1, 2),
        )
