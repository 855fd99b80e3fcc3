"""Guards for foreign files: what they claim to hold, and the paths that they name.

A few bytes may claim to be gigabytes, and a decoder believes them. Every reader of foreign bytes
compares the claim of the header here, then leaves the decoding to a library.
"""

from __future__ import annotations

import bz2
import math
import os
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import AT_ONCE, breaks_a_line, check_plain_file, shortened

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # NumPy writes no other compression
_READ_HEADER = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_ANY_HEADER = zlib.MAX_WBITS | 32  # zlib or gzip, as the stream says

ALWAYS_ALLOWED = 128 << 20
"""Bytes that any file may unpack to: less refuses masks of large cameras, which pack to almost
nothing; more lets a small damaged file take that much memory."""

RATIO = 32
"""Unpacked bytes that each stored byte may add: measured fields pack to a tenth at the least."""


def largest_claim(stored: int) -> int:
    """Return how many bytes a file of ``stored`` bytes may unpack to."""
    return ALWAYS_ALLOWED + RATIO * stored


def check_claim(claimed: int, stored: int) -> None:
    """Raise ValueError unless a file of ``stored`` bytes may unpack to ``claimed`` bytes."""
    if claimed < 0:
        raise ValueError(f"found a claim of {claimed} bytes, expected 0 or more: damaged")
    most = largest_claim(stored)
    if claimed > most:
        raise ValueError(
            f"found {stored} bytes that claim to hold {claimed}, expected at most {most}: the "
            "file is damaged, or has to be stored without compression"
        )


def decompressed(data: bytes | bytearray, most: int, method: str = "zlib") -> bytearray:
    """Return what a stream of zlib, gzip or ``"bzip2"`` holds, which may be ``most`` bytes.

    ValueError where it holds more, is truncated or claims more than `check_claim` allows.
    """
    check_claim(most, len(data))
    stream = bz2.BZ2Decompressor() if method == "bzip2" else zlib.decompressobj(_ANY_HEADER)
    found = bytearray()  # grows in place, where one call would hold the values twice
    while not stream.eof and len(found) <= most:
        piece = stream.decompress(data, min(AT_ONCE, most + 1 - len(found)))
        data = getattr(stream, "unconsumed_tail", b"")  # bz2 keeps what is left
        if not piece and not data:
            break
        found += piece
    if len(found) > most:
        raise ValueError(f"found compressed values of more than {most} bytes, expected no more")
    if not stream.eof:
        raise ValueError("found no end of the compressed values: truncated")
    return found


@contextmanager
def errors_of_libraries(where: str) -> Iterator[None]:
    """Turn any exception that a library raises over foreign bytes into one line of ValueError."""
    try:
        yield
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{where}: {reason}") from None


def read_arrays(path: str | os.PathLike) -> dict[str, NDArray]:
    """Return the arrays of an ``.npz`` archive by name.

    ValueError where it is damaged, holds Python objects or claims more than its size may hold.
    """
    check_plain_file(path)
    with errors_of_libraries("not a readable .npz"):
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            check_claim(sum(member.file_size for member in members), os.path.getsize(path))
            for member in members:
                _check_member(archive, member)
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)


def read_array(path: str | os.PathLike) -> NDArray:
    """Return the array of an ``.npy`` file; ValueError where it is damaged or holds objects."""
    check_plain_file(path)
    with errors_of_libraries("not a readable .npy"):
        with open(path, "rb") as file:
            _check_header(file, os.path.getsize(path), "header")
        return np.load(path, allow_pickle=False)


def _check_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> None:
    """Raise unless the shape in a member's header agrees with the member's size."""
    if member.compress_type not in _METHODS:
        raise ValueError(f"{member.filename}: found another compression, expected deflate or none")
    with archive.open(member) as file:
        _check_header(file, member.file_size, member.filename)


def _check_header(file: IO[bytes], size: int, what: str) -> None:
    """Raise unless the shape in an array's header agrees with the size of its file."""
    shape, _, dtype = _READ_HEADER[np.lib.format.read_magic(file)](file)
    left = size - file.tell()
    # NumPy gives text of no length one letter: any number of values for nothing
    if not dtype.itemsize or math.prod(shape) * dtype.itemsize != left:
        raise ValueError(f"{what}: found {left} bytes of values, expected {dtype} {shape}")


def path_inside(file: str, folder: Path, where: str, owner: str = "rig's") -> Path:
    """Return the path of a file that a file in ``folder`` names, or raise if it leaves the folder.

    ``file`` may have the slashes of any system; ``where`` names it and ``owner`` the folder's.
    """
    is_path = bool(file.strip()) and not breaks_a_line(file) and not PureWindowsPath(file).anchor
    path = folder / file.replace("\\", "/")
    try:
        # a name that no file system can hold raises in exists
        path.exists()
        is_inside = is_path and path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):
        is_inside = False
    if not is_inside:
        raise ValueError(
            f"{where}: found {shortened(file)}, expected a path inside the {owner} folder"
        )
    return path
