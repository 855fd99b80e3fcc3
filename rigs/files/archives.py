"""NumPy's ``.npz`` and ``.npy``, read by NumPy once their headers agree with their size."""

from __future__ import annotations

import math
import os
import zipfile
from typing import IO

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import check_plain_file

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # NumPy writes no other compression
_READ_HEADER = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def read_arrays(path: str | os.PathLike) -> dict[str, NDArray]:
    """Return the arrays of an ``.npz`` archive by name.

    Raises
    ------
    ValueError
        In one line, if the file is no archive of plain arrays, is damaged, holds Python objects,
        or claims more than a file of its size may hold.
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
    """Return the array of an ``.npy`` file.

    Raises
    ------
    ValueError
        In one line, if the file is no plain array, is damaged, or holds Python objects.
    """
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
        raise ValueError(
            f"{what}: found {left} bytes of values, expected {dtype} of shape {shape}"
        )
