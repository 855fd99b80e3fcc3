"""Recordings: the frames of one camera, in one of several formats behind one protocol.

A format is a module with a class that takes a path and has the members of `Recording`, and one
line of the table below.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

_VIDEO = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv")
_FORMATS = {
    ("rigs.recordings.video", "Video"): _VIDEO,
    ("rigs.recordings.tiff_stack", "TiffStack"): (".tif", ".tiff"),
}
"""Module and class of each format of one file, to its usual suffixes."""

FILM_SUFFIXES = _VIDEO
"""Suffixes that films alone have: a TIFF may be either a still image or a film."""


class Recording(Protocol):
    """The frames of one camera: opened in little time, and read when asked for, in any order.

    Several threads may read at once. Pixels are as stored, row 0 first.

    Attributes
    ----------
    n_frames : int
    image_size : (int, int)
        Width and height in pixels, of every frame.
    bit_depth : int or None
        Bits that were recorded of a pixel; None for floating-point numbers.
    frame_rate : float or None
        Frames a second, where the file says.
    timestamps : (n_frames,) float64 or None
        Seconds from the first frame, where the file says.
    notes : tuple of str
        What a user should know of the numbers, such as that they are not linear in light.
    """

    n_frames: int
    image_size: tuple[int, int]
    bit_depth: int | None
    frame_rate: float | None
    timestamps: NDArray[np.float64] | None
    notes: tuple[str, ...]

    def read(self, index: int) -> NDArray:
        """Return a frame ``(height, width)``, counted from 0.

        Raises
        ------
        IndexError
            If there is no such frame.
        ValueError
            If it cannot be decoded; the message names file and frame.
        """


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
        from rigs.recordings.image_sequence import ImageSequence
        from rigs.recordings.layout import images_in

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


def check_index(path: Path, index: int, n_frames: int) -> None:
    """Raise unless a recording has a frame; negative numbers name none."""
    if not 0 <= index < n_frames:
        raise IndexError(f"{path}: found frame {index}, expected 0 to {n_frames - 1}")


def check_size(path: Path, index: int, image: NDArray, size: tuple[int, int]) -> None:
    """Raise unless a frame has the size of the first.

    Raises
    ------
    ValueError
        Naming both.
    """
    if image.shape[::-1] != size:
        raise ValueError(
            f"{path}: frame {index}: found {image.shape[1]} x {image.shape[0]} pixels, expected "
            f"{size[0]} x {size[1]}, as in the first"
        )
