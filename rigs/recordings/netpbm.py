"""Portable grey and colour maps, PGM and PPM: other readers stretch their numbers to 16 bits."""

from __future__ import annotations

import re
import warnings

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim
from rigs.recordings.still import Still

_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"P([2356])" + 3 * (_GAP + rb"(\d{1,9})") + rb"\s")
_MARKS = (b"P2", b"P3", b"P5", b"P6")  # grey and colour as text, grey and colour as bytes


def is_netpbm(content: bytes) -> bool:
    """Return whether a file begins as a PGM or PPM does."""
    return content.startswith(_MARKS)


def netpbm_size(content: bytes) -> tuple[int, int]:
    """Return the width and height that a header claims."""
    return _header(content)[1:3]


def read_netpbm(content: bytes) -> Still:
    """Return the image of a PGM or PPM; its full scale is the file's own.

    Numbers above 255 are two bytes, the high one first: https://netpbm.sourceforge.net/doc.
    """
    kind, width, height, full, start = _header(content)
    channels = 3 if kind in (3, 6) else 1
    count, kept = width * height * channels, np.uint16 if full > 255 else np.uint8
    check_claim(2 * count, len(content))
    if kind in (2, 3):
        found = _as_text(content[start:])
    else:
        stored = np.dtype(">u2" if full > 255 else np.uint8)
        held = min(count, (len(content) - start) // stored.itemsize)
        found = np.frombuffer(content, stored, held, start)
    if len(found) < count:
        raise ValueError(f"found {len(found)} numbers, expected {count}: damaged or truncated")
    found = found[:count]
    if found.max() > full or found.min() < 0:
        wrong = found.max() if found.max() > full else found.min()
        raise ValueError(f"found a pixel of {wrong}, expected 0 to {full}, the file's full scale")
    shape = (height, width, 3) if channels == 3 else (height, width)
    return Still(found.astype(kept).reshape(shape), full)


def _as_text(content: bytes) -> NDArray[np.int64]:
    """Return the whole numbers in a text, as far as there are."""
    try:
        with warnings.catch_warnings(action="ignore"):  # of letters: the numbers are counted
            return np.fromstring(content, np.int64, sep=" ")
    except ValueError:
        raise ValueError("found a text that holds more than numbers: damaged") from None


def _header(content: bytes) -> tuple[int, int, int, int, int]:
    """Return kind, width, height, full scale, and where the numbers begin."""
    match = _HEADER.match(content)
    if match is None:
        raise ValueError("found no header of a PGM or PPM: damaged or truncated")
    kind, width, height, full = map(int, match.groups())
    if min(width, height) < 1 or not 1 <= full <= 65535:
        raise ValueError(f"found {width} x {height} pixels up to {full}, expected some to 65535")
    return kind, width, height, full, match.end()
