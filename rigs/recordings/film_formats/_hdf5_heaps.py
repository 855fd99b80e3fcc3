"""A look at the texts of an HDF5 file before its library, which never ends on some damage."""

from __future__ import annotations

import os
import struct

_MARK = b"GCOL\x01\0\0\0"  # a collection of texts, version 1
_LOOKED_AT = 16 << 20  # bytes at each end of a file: heads and late attributes stand there
_OBJECT = struct.Struct("<HHIQ")  # number, references, reserved, size


def check_heaps(path: str | os.PathLike) -> None:
    """Raise where a collection of texts at either end of a file cannot be walked through.

    Raises
    ------
    ValueError
        Naming the place.

    Notes
    -----
    The layout is that of "HDF5 File Format Specification", III.E. Objects are filled up to eight
    bytes; object 0 is the free space, its size includes its head.
    """
    with open(path, "rb") as file:
        held = file.seek(0, os.SEEK_END)
        for start in {0, max(0, held - _LOOKED_AT)}:
            file.seek(start)
            content = file.read(_LOOKED_AT)
            at = content.find(_MARK)
            while at >= 0:
                _check_heap(content[at : at + (1 << 16)], start + at)
                at = content.find(_MARK, at + len(_MARK))


def _check_heap(content: bytes, place: int) -> None:
    """Raise unless the sizes of a collection's objects lead to its end."""
    if len(content) < 16:
        raise ValueError(f"found a collection of texts at byte {place} that ends at once: damaged")
    (size,) = struct.unpack_from("<Q", content, 8)
    at = 16
    while at + _OBJECT.size <= min(size, len(content)):
        number, _, _, length = _OBJECT.unpack_from(content, at)
        step = length if number == 0 else _OBJECT.size + length + -length % 8
        if step < _OBJECT.size or at + step > size:
            raise ValueError(f"found a text at byte {place + at} of {length} bytes: damaged")
        at += step
