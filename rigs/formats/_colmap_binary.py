"""COLMAP's binary models, turned into the lines of their text form.

``cameras.bin, images.bin, rigs.bin``: little-endian, a count (uint64), then the entries, in the
order of the text files. The image points of ``images.bin`` are skipped. Source:
``scripts/python/read_write_model.py`` and ``src/colmap/scene/reconstruction_io_binary.cc`` at
https://github.com/colmap/colmap.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from rigs.formats._colmap_lenses import MODELS

_NUMBERS = {number: name for name, (number, _, _) in MODELS.items()}
_LONGEST_NAME = 4096  # bytes of an image's path; Linux allows no longer one
_POINT = 24  # bytes of an image point: two float64 and the number of its 3-D point
_KINDS = {0: "CAMERA", 1: "IMU"}  # of sensors; other numbers are written as they are


def text_of(file: Path) -> str:
    """Return the lines that a text model has in the place of a binary file.

    Raises
    ------
    ValueError
        If the file ends early or is longer than its entries.
    """
    entries = _ENTRIES[file.stem]
    with file.open("rb") as stream:
        (count,) = _unpacked(stream, "Q")
        lines: list[str] = []
        for _ in range(count):
            lines += entries(stream)
        if stream.read(1):
            raise ValueError(f"found more bytes after {count} entries, expected the file's end")
    return "\n".join([*lines, ""])


def _unpacked(stream: BinaryIO, layout: str) -> tuple:
    """Return the next values of a stream."""
    size = struct.calcsize(f"<{layout}")
    data = stream.read(size)
    if len(data) < size:
        raise ValueError(f"found the file's end at byte {stream.tell()}, expected another entry")
    return struct.unpack(f"<{layout}", data)


def _camera(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of a camera."""
    key, number, width, height = _unpacked(stream, "IiQQ")
    if number not in _NUMBERS:
        raise ValueError(
            f"camera {key}: MODEL: found number {number}, expected 0 to {max(_NUMBERS)}"
        )
    name = _NUMBERS[number]
    values = _unpacked(stream, f"{len(MODELS[name][2].split())}d")
    yield " ".join([str(key), name, str(width), str(height), *map(repr, values)])


def _image(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of an image, and an empty one for its points."""
    key, *pose, camera = _unpacked(stream, "I7dI")
    name = bytearray()
    while (byte := stream.read(1)) not in (b"\0", b""):
        name += byte
        if len(name) > _LONGEST_NAME:
            raise ValueError(f"image {key}: NAME: found more than {_LONGEST_NAME} bytes")
    (points,) = _unpacked(stream, "Q")
    here = stream.tell()
    if points * _POINT > stream.seek(0, 2) - here:
        raise ValueError(f"image {key}: found the file's end before its {points} points")
    stream.seek(here + points * _POINT)
    try:
        text = name.decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"image {key}: NAME: found bytes that are not UTF-8") from None
    if text.splitlines() != [text]:
        raise ValueError(f"image {key}: NAME: found {text[:60]!r}, expected one line")
    yield " ".join([str(key), *map(repr, pose), str(camera), text])
    yield ""


def _rig(stream: BinaryIO) -> Iterator[str]:
    """Yield the line of a rig."""
    key, sensors = _unpacked(stream, "II")
    words = [str(key), str(sensors)]
    for index in range(sensors):
        kind, number = _unpacked(stream, "iI")
        words += [_KINDS.get(kind, str(kind)), str(number)]
        if index:  # the first is the reference, without a pose
            (has_pose,) = _unpacked(stream, "B")
            words.append(str(int(has_pose != 0)))
            if has_pose:
                words += map(repr, _unpacked(stream, "7d"))
    yield " ".join(words)


_ENTRIES: dict[str, Callable[[BinaryIO], Iterator[str]]] = {
    "cameras": _camera,
    "images": _image,
    "rigs": _rig,
}
