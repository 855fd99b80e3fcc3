"""Recordings: the frames of one camera, behind one protocol whatever the format."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


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
        Lines that a user should know of the numbers, such as that they are not linear in light.
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
