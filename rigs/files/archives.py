"""Packed files unpacked within bounds: a few bytes may claim to be gigabytes."""

from __future__ import annotations

import bz2
import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

FREE = 128 << 20  # bytes that any file may unpack to; masks pack to almost nothing
RATIO = 32  # times its size that a larger one may; measured fields pack to a tenth at the least
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # what NumPy writes


@contextmanager
def errors_of_libraries(where: str) -> Iterator[None]:
    """Turn whatever libraries raise over foreign bytes into one line of ValueError."""
    try:
        yield
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{where}: {reason}") from None


def most_unpacked(stored: int) -> int:
    """Return to how many bytes a file of ``stored`` bytes may unpack."""
    return FREE + RATIO * stored


def check_unpacked(count: int, stored: int) -> None:
    """Raise unless a file of ``stored`` bytes may unpack to ``count``.

    Raises
    ------
    ValueError
        Naming both.
    """
    if count < 0:
        raise ValueError(f"found {count} bytes to unpack to, expected 0 or more: damaged")
    most = most_unpacked(stored)
    if count > most:
        raise ValueError(
            f"found {stored} bytes that unpack to {count}, expected at most {most}: damaged, "
            "or to be stored without compression"
        )


def inflated(data: bytes, count: int) -> bytes:
    """Return the ``count`` bytes that a zlib or gzip stream holds.

    Raises
    ------
    ValueError
        If it holds more or less, or is truncated.
    """
    return _taken(zlib.decompressobj(zlib.MAX_WBITS | 32), data, count)


def unzipped(data: bytes, count: int) -> bytes:
    """Return the ``count`` bytes that a bzip2 stream holds; see `inflated`."""
    return _taken(bz2.BZ2Decompressor(), data, count)


def _taken(stream: object, data: bytes, count: int) -> bytes:
    check_unpacked(count, len(data))
    found = stream.decompress(data, count + 1)
    if len(found) != count:
        more = "more" if len(found) > count else len(found)
        raise ValueError(f"found {more} bytes of values, expected {count}")
    if not stream.eof:
        raise ValueError(f"found no end of the {count} bytes of values, truncated")
    return found


def read_arrays(path: str | os.PathLike) -> dict[str, NDArray]:
    """Return the arrays of an ``.npz`` archive by name.

    Raises
    ------
    ValueError
        In one line, if it is no archive of plain arrays, is damaged, or holds Python objects or
        more than a file of its size may.
    """
    with errors_of_libraries("not a readable .npz"), open(path, "rb") as file:
        if file.read(6) == b"\x93NUMPY":
            raise ValueError("found a single array, expected several under their names")
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            check_unpacked(sum(item.file_size for item in members), os.path.getsize(path))
            return {item.filename.removesuffix(".npy"): _array(archive, item) for item in members}


def _array(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> NDArray:
    """Return the array of a member, whose header has to agree with the member's size."""
    if item.compress_type not in _METHODS:
        raise ValueError(f"{item.filename}: found another compression, expected deflate or none")
    with archive.open(item) as file:
        shape, is_fortran, dtype = _header(file)
        if dtype.hasobject:
            raise ValueError(f"{item.filename}: found Python objects, expected numbers or text")
        if not dtype.itemsize:  # NumPy gives text of no length one letter: any number for nothing
            raise ValueError(
                f"{item.filename}: found values of no bytes, expected numbers or text"
            )
        count = math.prod(shape) * dtype.itemsize
        left = item.file_size - file.tell()
        if min(shape, default=0) < 0 or count != left:
            raise ValueError(
                f"{item.filename}: found {left} bytes of values, expected {dtype} {shape}"
            )
        values = bytearray(file.read())
    if not count:
        return np.zeros(shape, dtype)
    return np.frombuffer(values, dtype).reshape(shape, order="F" if is_fortran else "C")


def _header(file: BinaryIO) -> tuple[tuple[int, ...], bool, np.dtype]:
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        return np.lib.format.read_array_header_1_0(file)
    if version == (2, 0):
        return np.lib.format.read_array_header_2_0(file)
    raise ValueError(f"found NumPy's format {version}, expected (1, 0) or (2, 0)")
