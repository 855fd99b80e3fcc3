"""Pixels that lie in a file one after the other, each in a fixed number of bits."""

from __future__ import annotations

import os
import re
from typing import Literal

import numpy as np
from numpy.typing import NDArray

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

    Raises
    ------
    ValueError
        If the file ends before.
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

    Raises
    ------
    ValueError
        If there are fewer bytes.
    """
    width, height = size
    count = width * height
    if len(data) < bytes_of(pixel_type, count):
        raise ValueError(
            f"found {len(data)} bytes, expected {bytes_of(pixel_type, count)}: truncated"
        )
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
