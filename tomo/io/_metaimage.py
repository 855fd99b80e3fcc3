"""MetaImage (.mha, .mhd): a header of lines ``Key = Value``, values behind it or in a file beside.

MetaIO itself fills a volume with what is in memory where its values do not unpack.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import decompressed
from tomo.io._axes import HEADER, content_beside, in_order, numbers_in

_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4",
    "MET_UINT": "u4", "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4", "MET_DOUBLE": "f8",
}  # fmt: skip
_LAST = b"ElementDataFile"  # the key of the last line


def read(path: Path) -> tuple[NDArray, NDArray, NDArray, str, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and both units."""
    content = path.read_bytes()
    fields, start = _fields(content)
    for key, value in (
        ("NDims", "3"),
        ("BinaryData", "True"),
        ("HeaderSize", "0"),
        ("ElementNumberOfChannels", "1"),
    ):
        found = fields.get(key, "none" if key in ("NDims", "BinaryData") else value)
        if found.lower() != value.lower():
            raise ValueError(f"{key}: found {found[:60]}, expected {value}")
    kind = fields.get("ElementType", "none")
    if kind not in _TYPES:
        raise ValueError(f"ElementType: found {kind[:60]!r}, expected one of {', '.join(_TYPES)}")
    order = ">" if _is_true(fields, "BinaryDataByteOrderMSB", "ElementByteOrderMSB") else "<"
    dtype = np.dtype(order + _TYPES[kind])
    sizes = _numbers(fields, ("DimSize",), 3, None)
    if not all(size.is_integer() and size >= 1 for size in sizes.tolist()):
        raise ValueError(f"DimSize: found {fields['DimSize'][:60]!r}, expected whole numbers >= 1")
    shape = tuple(int(size) for size in sizes)
    count = math.prod(shape) * dtype.itemsize
    values: bytes | bytearray = content[start:]
    if (name := fields[_LAST.decode()]).upper() != "LOCAL":
        values = content_beside(path, name, _LAST.decode())
    if _is_true(fields, "CompressedData"):
        values = decompressed(values, count)
    if len(values) < count:
        raise ValueError(f"found {len(values)} bytes of values, expected {count}: truncated")
    data = np.frombuffer(values, dtype, math.prod(shape)).reshape(shape, order="F")
    spacing = _numbers(fields, ("ElementSpacing", "ElementSize"), 3, np.ones(3))
    origin = _numbers(fields, ("Offset", "Position", "Origin"), 3, np.zeros(3))
    axes = _numbers(fields, ("TransformMatrix", "Rotation", "Orientation"), 9, np.eye(3).ravel())
    steps = axes.reshape(3, 3) * spacing[:, None]
    return *in_order(data, origin, steps, "TransformMatrix", spacing), "mm", ""


def _fields(content: bytes) -> tuple[dict[str, str], int]:
    """Return the lines of the header, and where the values begin."""
    fields: dict[str, str] = {}
    start = 0
    while _LAST.decode() not in fields:
        end = content.find(b"\n", start, HEADER)
        if end < 0:
            raise ValueError(f"{_LAST.decode()}: missing, expected the header of a MetaImage")
        line = content[start:end].decode("latin-1")
        key, _, value = (part.strip() for part in line.partition("="))
        if key in fields:
            raise ValueError(f"{key[:60]}: found twice, expected once")
        fields[key] = value
        start = end + 1
    return fields, start


def _is_true(fields: dict[str, str], *keys: str) -> bool:
    """Return whether a field says so; MetaIO looks at its first letter."""
    return any(fields.get(key, "")[:1] in ("T", "t", "1") for key in keys)


def _numbers(
    fields: dict[str, str], keys: tuple[str, ...], count: int, default: NDArray | None
) -> NDArray[np.float64]:
    """Return the numbers of the first of some fields that is there."""
    key = next((key for key in keys if key in fields), None)
    if key is None:
        if default is None:
            raise ValueError(f"{keys[0]}: missing in the header")
        return default
    return numbers_in(fields[key], key, count)
