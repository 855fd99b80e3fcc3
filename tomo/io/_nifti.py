"""NIfTI-1 (.nii, .nii.gz) by nibabel, from bytes that were unpacked and weighed here.

The world is that of the file's affine.
"""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, decompressed, largest_claim
from tomo.io._axes import in_order

_HEADER = 348  # bytes of a header
_FAR = 1 << 20  # bytes before the values, at most: extensions of the header
_UNITS = {"meter": "m", "mm": "mm", "micron": "um", "unknown": "mm"}


def read(path: Path) -> tuple[NDArray, NDArray, NDArray, str, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and both units."""
    content: bytes | bytearray = path.read_bytes()
    if content.startswith(b"\x1f\x8b"):
        content = decompressed(content, largest_claim(len(content)))
    _check(content, path.stat().st_size)
    nibabel = _library()
    with _strict(nibabel):
        image = nibabel.Nifti1Image.from_bytes(bytes(content))
        data = np.asarray(image.dataobj)
    data = data.reshape(data.shape[:3])
    steps, origin = image.affine[:3, :3].T, image.affine[:3, 3]
    unit = image.header.get_xyzt_units()[0]
    if unit not in _UNITS:
        raise ValueError(f"xyzt_units: found {unit}, expected one of {', '.join(_UNITS)}")
    return *in_order(data, origin, steps, "affine"), _UNITS[unit], ""


def _check(content: bytes | bytearray, stored: int) -> None:
    """Raise unless a file has a NIfTI-1 header of one volume and as many values as it says."""
    if len(content) < _HEADER:
        raise ValueError(f"found {len(content)} bytes, expected a NIfTI-1 header of {_HEADER}")
    order = "<" if content[:4] == struct.pack("<i", _HEADER) else ">"
    (size,) = struct.unpack_from(f"{order}i", content)
    if size != _HEADER or content[344:347] != b"n+1":
        raise ValueError("found no NIfTI-1 header with the values in the same file, expected one")
    count, *sizes = struct.unpack_from(f"{order}8h", content, 40)
    if not 3 <= count <= 7 or min(sizes[:count]) < 1 or any(n != 1 for n in sizes[3:count]):
        raise ValueError(f"dim: found {[count, *sizes]}, expected three sizes >= 1")
    (bits,) = struct.unpack_from(f"{order}h", content, 72)
    (start,) = struct.unpack_from(f"{order}f", content, 108)
    if not (0 < bits <= 64 and _HEADER <= start <= _FAR):
        raise ValueError(
            f"found {bits} bits a voxel from byte {start}, expected up to 64 from 352"
        )
    wanted = math.prod(sizes[:3]) * bits // 8 + int(start)
    check_claim(wanted, stored)
    if len(content) < wanted:
        raise ValueError(f"found {len(content)} bytes, expected {wanted}: truncated")


@contextmanager
def _strict(nibabel: ModuleType) -> Iterator[None]:
    """Have nibabel raise where it would mend a header by a guess, and print nothing."""
    messages, quiet = nibabel.imageglobals, logging.NullHandler()
    with messages.ErrorLevel(logging.WARNING), messages.LoggingOutputSuppressor():
        messages.logger.addHandler(quiet)  # without any, Python's own prints
        try:
            yield
        finally:
            messages.logger.removeHandler(quiet)


def _library() -> ModuleType:
    """Return nibabel, or say how it is installed."""
    try:
        import nibabel
    except ImportError:
        raise ValueError(
            "found no package nibabel, which reads NIfTI, expected it installed: "
            "pip install 'flametomo[nifti]'"
        ) from None
    return nibabel
