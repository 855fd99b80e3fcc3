"""What was found before, in one plain file, so that images are searched once."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rigs._atomic import atomic_path
from rigs.calibrate._found import Found
from rigs.calibrate.image_sets import Source, VideoFrame

_FORMAT = "target detections 1"  # another number where the search gives other results
_FIELDS = ("format", "keys", "counts", "point", "uv", "blur", "reason", "legacy", "size")

Entry = tuple[Found, tuple[int, int]]
"""What was found, and the image's width and height."""


def key(target: str, camera: str, frame: str, source: Source) -> str:
    """Return a text that changes when the target or the image does."""
    if isinstance(source, np.ndarray):
        content = np.ascontiguousarray(source)
        digest = hashlib.sha256(content.tobytes()).hexdigest()
        identity = f"{content.dtype} {content.shape} {digest}"
    else:
        path = Path(source.path if isinstance(source, VideoFrame) else source)
        try:
            state = path.stat()
        except OSError as error:
            raise ValueError(
                f"camera {camera}: {path}: cannot be read: {error.strerror}"
            ) from None
        identity = f"{path.absolute()} {state.st_size} {state.st_mtime_ns}"
        if isinstance(source, VideoFrame):
            identity += f" {source.index}"
    return "\n".join((target, camera, frame, identity))


def read(path: Path) -> dict[str, Entry]:
    """Return the entries of the cache at ``path``, none if there is no such file.

    Raises
    ------
    ValueError
        If there is another kind of file, so that it is not overwritten.
    """
    if not path.exists():
        return {}
    try:
        with np.load(path, allow_pickle=False) as file:
            if str(file["format"]) != _FORMAT:
                return {}
            stored = {name: file[name] for name in _FIELDS}
    except Exception:  # damaged archives raise errors of half a dozen modules
        raise ValueError(
            f"{path}: found another kind of file, expected a cache of detections or none"
        ) from None
    ends = np.cumsum(stored["counts"])
    entries = {}
    for k, name in enumerate(stored["keys"].tolist()):
        rows = slice(int(ends[k] - stored["counts"][k]), int(ends[k]))
        legacy = {-1: None, 0: False, 1: True}[int(stored["legacy"][k])]
        found = Found(
            stored["point"][rows],
            stored["uv"][rows],
            float(stored["blur"][k]),
            str(stored["reason"][k]),
            legacy,
        )
        entries[name] = found, (int(stored["size"][k, 0]), int(stored["size"][k, 1]))
    return entries


def write(path: Path, entries: Mapping[str, Entry]) -> None:
    """Write the entries under a temporary name beside ``path``, then rename it."""
    found = [entry[0] for entry in entries.values()]
    stored = {
        "format": np.array(_FORMAT),
        "keys": np.array(list(entries), dtype=np.str_),
        "counts": np.array([len(item.point) for item in found], np.int64),
        "point": np.concatenate([np.zeros(0, np.int64), *(item.point for item in found)]),
        "uv": np.concatenate([np.zeros((0, 2)), *(item.uv for item in found)]),
        "blur": np.array([item.blur for item in found], np.float64),
        "reason": np.array([item.reason for item in found], dtype=np.str_),
        "legacy": np.array([-1 if i.legacy is None else int(i.legacy) for i in found], np.int64),
        "size": np.array([entry[1] for entry in entries.values()], np.int64).reshape(-1, 2),
    }
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **stored)
