"""Binary films without a header of their own, described by the user.

Pixels that lie in a file one after the other, each in a fixed number of bits.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rigs.recordings.recording import Reopened

PIXEL_TYPES = (
    *("uint8", "uint10", "uint12", "uint16", "uint32", "int8", "int16", "int32"),
    *("float32", "float64"),
)
"""Kinds of pixels. Those of 10 and 12 bits are packed without gaps, the high bits first."""

BYTE_ORDERS: dict[str, Literal["<", ">"]] = {"little": "<", "big": ">"}
_PACKED = {"uint10": (5, 4), "uint12": (3, 2)}  # bytes, and the pixels in them


def bytes_of(pixel_type: str, count: int) -> int:
    """Return how many bytes so many pixels take; the last may be used in part."""
    return -(-int(re.sub(r"\D", "", pixel_type)) * count // 8)


def read_part(path: str | os.PathLike, start: int, size: int) -> bytes:
    """Return ``size`` bytes of a file from ``start`` on.

    The file is opened each time: any thread may read, and nothing is left open.
    """
    with open(path, "rb") as file:
        held = file.seek(0, os.SEEK_END)
        if start < 0 or size < 0 or start + size > held:
            raise ValueError(f"found {held} bytes, expected {start + size}: damaged or truncated")
        file.seek(start)
        return file.read(size)


def pixels_of(
    data: bytes, size: tuple[int, int], pixel_type: str, byte_order: str = "little"
) -> NDArray:
    """Return the image ``(height, width)`` in the bytes of its rows, the first row first.

    Pixels of 10 and 12 bits become uint16.
    """
    width, height = size
    count = width * height
    if len(data) < bytes_of(pixel_type, count):
        raise ValueError(f"found {len(data)} of {bytes_of(pixel_type, count)} bytes: truncated")
    if pixel_type in _PACKED:
        return _unpacked(data, pixel_type, count).reshape(height, width)
    stored = np.dtype(pixel_type).newbyteorder(BYTE_ORDERS[byte_order])
    image = np.frombuffer(data, stored, count).reshape(height, width)
    return image.astype(stored.newbyteorder("="))


def _unpacked(data: bytes, pixel_type: str, count: int) -> NDArray[np.uint16]:
    """Return the pixels packed in groups of bytes, like aaaaaaaa aabbbbbb bbbbcccc for 10 bits."""
    size, pixels = _PACKED[pixel_type]
    groups = -(-count // pixels)
    padded = np.zeros(groups * size, np.uint8)
    used = min(len(data), len(padded))
    padded[:used] = np.frombuffer(data, np.uint8, used)
    parts = padded.reshape(groups, size).astype(np.uint16).T
    bits = 8 * size // pixels
    found = np.zeros((groups, pixels), np.uint16)
    for number in range(pixels):
        first, gone = divmod(number * bits, 8)  # the byte it begins in, and its bits used before
        low = 16 - gone - bits  # bits of the next byte that belong to later pixels
        found[:, number] = ((parts[first] << 8 | parts[first + 1]) >> low) & ((1 << bits) - 1)
    return found.reshape(-1)[:count]


@dataclass(frozen=True)
class RawLayout:
    """Where the frames lie in a binary file, and how their pixels are stored.

    Parameters
    ----------
    width, height : int
        Pixels.
    dtype : str
        One of `PIXEL_TYPES`; ``uint10`` and ``uint12`` are packed without gaps.
    byte_order : {"little", "big"}
    header_bytes : int
        Bytes before the first frame.
    gap_bytes : int
        Bytes from the end of a frame to the next.

    Raises
    ------
    ValueError
        If a value is out of its range.

    Examples
    --------
    >>> RawLayout(1024, 512, "uint12").frame_bytes
    786432
    """

    width: int
    height: int
    dtype: str
    byte_order: str = "little"
    header_bytes: int = 0
    gap_bytes: int = 0

    def __post_init__(self) -> None:
        """Check every value."""
        for name, least in (("width", 1), ("height", 1), ("header_bytes", 0), ("gap_bytes", 0)):
            value = getattr(self, name)
            if value < least:
                raise ValueError(f"{name}: found {value}, expected {least} or more")
        for name, known in (("dtype", PIXEL_TYPES), ("byte_order", BYTE_ORDERS)):
            value = getattr(self, name)
            if value not in known:
                raise ValueError(f"{name}: found {value!r}, expected one of {', '.join(known)}")

    @property
    def frame_bytes(self) -> int:
        """Bytes of a frame."""
        return bytes_of(self.dtype, self.width * self.height)

    def start_of(self, index: int) -> int:
        """Return where a frame begins in the file, in bytes."""
        return self.header_bytes + index * (self.frame_bytes + self.gap_bytes)


class RawFilm(Reopened):
    """The frames in a binary file; see `Recording`."""

    def __init__(self, path: str | os.PathLike, layout: RawLayout) -> None:
        self.path, self.layout = Path(path), layout
        self.image_size = (layout.width, layout.height)
        is_integer = not layout.dtype.startswith("float")
        self.bit_depth = bytes_of(layout.dtype, 8) if is_integer else None
        held = self.path.stat().st_size
        step = layout.frame_bytes + layout.gap_bytes
        self.n_frames, rest = divmod(held - layout.header_bytes + layout.gap_bytes, step)
        if self.n_frames < 1 or rest not in (0, layout.gap_bytes):
            raise ValueError(
                f"{self.path}: found {held} bytes, expected {layout.header_bytes} before frames "
                f"of {layout.frame_bytes} bytes with {layout.gap_bytes} between them: check the "
                "description of the raw film, or the file is truncated"
            )

    def _opened_by(self) -> tuple:
        return self.path, self.layout

    def _frame(self, index: int) -> NDArray:
        data = read_part(self.path, self.layout.start_of(index), self.layout.frame_bytes)
        return pixels_of(data, self.image_size, self.layout.dtype, self.layout.byte_order)
