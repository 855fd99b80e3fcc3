"""Formats of one file a camera: a file is a camera, a folder of them a rig."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rigs.camera_protocol import CameraLike
from rigs.formats._values import errors_of_file


def cameras_of(
    path: Path,
    files_of: Callable[[Path], list[Path]],
    read: Callable[[Path], CameraLike],
    what: str,
) -> tuple[CameraLike, ...]:
    """Return the camera of a file, or those of a folder.

    Parameters
    ----------
    path : Path
    files_of : callable
        From a folder to its cameras' files.
    read : callable
        From a file to its camera.
    what : str
        The files that a folder should hold.

    Raises
    ------
    ValueError
        If a folder holds none; or of a camera, beginning with its file.
    """
    files = files_of(path) if path.is_dir() else [path]
    if not files:
        raise ValueError(f"{path}: found no {what}")
    cameras = []
    for file in files:
        with errors_of_file(file):
            cameras.append(read(file))
    return tuple(cameras)
