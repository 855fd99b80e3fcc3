"""Images out of files' bytes, by OpenCV: what a file claims is looked at before it is decoded."""

from __future__ import annotations

import re
import struct

import numpy as np
from numpy.typing import NDArray

from rigs.files.archives import check_unpacked

_SAMPLES = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # of a PNG's kinds of colour; palettes become colours
_WHOLE = {1: "B", 3: "H", 4: "I", 6: "b", 8: "h", 9: "i"}  # a TIFF's kinds of whole numbers
_WHOLE_IN_BIG = _WHOLE | {16: "Q", 17: "q"}
_MOST_TAGS = 4096
_MARKER = re.compile(rb"\xff[^\x00\xff]")  # of a JPEG's segments
_PNG, _JPEG, _WEBP = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"RIFF"


def decoded(content: bytes) -> NDArray:
    """Return the image ``(rows, columns)`` or ``(rows, columns, channels)`` that a file holds.

    Raises
    ------
    ValueError
        If it is none, or truncated, or claims to be far larger than the file is.
    """
    import cv2

    # OpenCV hands back what it could decode of a truncated file, so look for the end mark first
    if content.startswith(_PNG[:4]) and b"IEND" not in content[-64:]:
        raise ValueError("found no end mark (IEND), truncated")
    if content.startswith(_JPEG) and b"\xff\xd9" not in content[-1024:]:
        raise ValueError("found no end mark (EOI), truncated")
    check_unpacked(_claimed(content), len(content))
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError(" ".join(f"OpenCV: {error.err}".split())) from None
    if image is None:
        raise ValueError("damaged, empty or of another format")
    return image


def size_of(content: bytes) -> tuple[int, int]:
    """Return the width and height in pixels that a file claims; nothing is decoded.

    Raises
    ------
    ValueError
        If it is no image of a kind known.
    """
    width, height, _ = _header(content)
    return width, height


def _claimed(content: bytes) -> int:
    """Return how many bytes an image takes by what its file says, at least two a pixel."""
    width, height, depth = _header(content)
    return width * height * max(depth, 2)


def _header(content: bytes) -> tuple[int, int, int]:
    """Return width, height and bytes a pixel."""
    try:
        if content.startswith(_PNG):
            return _png(content)
        if content.startswith(_JPEG):
            return _jpeg(content)
        if content.startswith((b"II", b"MM")):
            return _tiff(content)
        if content.startswith(b"BM"):
            width, height = struct.unpack_from("<2i", content, 18)
            return abs(width), abs(height), 4
        if content.startswith(_WEBP) and content[8:12] == b"WEBP":
            return _webp(content)
        found = re.match(rb"P[1-6]\s(?:\s|#[^\r\n]*[\r\n])*+(\d{1,9})\s++(\d{1,9})\s", content)
        if found:
            return int(found[1]), int(found[2]), 6
    except (struct.error, IndexError, OverflowError):
        raise ValueError("found no size in its header, damaged or truncated") from None
    raise ValueError("damaged, empty or of another format")


def _png(content: bytes) -> tuple[int, int, int]:
    """Read the first chunk, once all of them are known to lie inside the file.

    OpenCV asks for the memory that a chunk's length claims, and fills it.
    """
    at, name = len(_PNG), b""
    while name != b"IEND":
        length, name = struct.unpack_from(">I4s", content, at)
        at += 12 + length
        if at > len(content):
            raise ValueError(f"found a chunk of {length} bytes, expected no more than there are")
    width, height, bits, kind = struct.unpack_from(">2I2B", content, 16)
    return width, height, max(bits // 8, 1) * _SAMPLES.get(kind, 4)


def _jpeg(content: bytes) -> tuple[int, int, int]:
    """Look for the first frame header among the segments."""
    at = 2
    while found := _MARKER.search(content, at):
        at = found.start()
        marker = content[at + 1]
        if marker == 0x01 or 0xD0 <= marker <= 0xD7:  # these have no length
            at += 2
            continue
        (length,) = struct.unpack_from(">H", content, at + 2)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">2H", content, at + 5)
            return width, height, 4
        at += 2 + length
    raise IndexError


def _tiff(content: bytes) -> tuple[int, int, int]:
    """Read the first directory of a TIFF, ordinary or big."""
    order = "<" if content.startswith(b"II") else ">"
    (version,) = struct.unpack_from(f"{order}H", content, 2)
    is_big = version == 43
    (at,) = struct.unpack_from(f"{order}{'Q' if is_big else 'I'}", content, 8 if is_big else 4)
    (count,) = struct.unpack_from(f"{order}{'Q' if is_big else 'H'}", content, at)
    at += 8 if is_big else 2
    step, value_at, codes = (20, 12, _WHOLE_IN_BIG) if is_big else (12, 8, _WHOLE)
    if count > _MOST_TAGS:
        raise IndexError
    tags = {}
    for entry in range(at, at + step * count, step):
        tag, kind = struct.unpack_from(f"{order}2H", content, entry)
        if tag in (256, 257, 258, 277):
            # of a tag that stands there twice, libraries differ in which one they take
            if tag in tags or kind not in codes:
                raise IndexError
            (tags[tag],) = struct.unpack_from(f"{order}{codes[kind]}", content, entry + value_at)
    if not {256, 257} <= tags.keys() or min(tags.values()) < 0:
        raise IndexError
    # bits of several samples stand elsewhere: no sample has more than eight bytes
    samples = tags.get(277, 1)
    bits = tags.get(258, 8) if samples == 1 else 64
    return tags[256], tags[257], max(bits // 8, 1) * samples


def _webp(content: bytes) -> tuple[int, int, int]:
    kind = content[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(content[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    else:
        width, height = (n & 0x3FFF for n in struct.unpack_from("<2H", content, 26))
    return width, height, 4
