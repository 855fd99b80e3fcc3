"""The formats of recordings: a table, and opening a file by it.

A format is a module with a class that takes a path and has the members of `Recording`, and one
line of the table.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

from rigs.recordings.image_sequence import ImageSequence
from rigs.recordings.layout import images_in
from rigs.recordings.recording import Recording
from rigs.recordings.tiff_stack import is_stack
from rigs.recordings.write import TIFF_SUFFIXES

_VIDEO = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv")
_FORMATS = {
    ("rigs.recordings.video", "Video"): _VIDEO,
    ("rigs.recordings.tiff_stack", "TiffStack"): TIFF_SUFFIXES,
}
"""Module and class of each format of one file, to its usual suffixes."""

FILM_SUFFIXES = _VIDEO
"""Suffixes that films alone have: a TIFF may be either a still image or a film."""


def is_film(path: Path) -> bool:
    """Return whether a file is a video, or a TIFF of several pages of one size."""
    return path.suffix.lower() in FILM_SUFFIXES or is_stack(path)


def open_recording(path: str | os.PathLike) -> Recording:
    """Return the frames of a camera in a folder of images, or in a film of one file.

    Raises
    ------
    ValueError
        If the file's suffix belongs to no format, or it cannot be read.
    FileNotFoundError
        If there is nothing at ``path``.
    """
    path = Path(path)
    if path.is_dir():
        return ImageSequence(images_in(path), path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such recording")
    for (module, name), suffixes in _FORMATS.items():
        if path.suffix.lower() in suffixes:
            return getattr(import_module(module), name)(path)
    known = ", ".join(suffix for suffixes in _FORMATS.values() for suffix in suffixes)
    raise ValueError(
        f"{path}: recording: found suffix {path.suffix!r}, expected a folder of images, or one "
        f"of {known}"
    )
