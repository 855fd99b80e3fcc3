"""VTK ImageData XML, as far as one scalar volume needs it.

The writer stores one float32 point array, appended raw, little-endian, with 64-bit headers. The
reader also takes other programs' files: point or cell data, inline (ascii or base64) or appended
(raw or base64), compressed by zlib or not.
"""

from __future__ import annotations

import base64
import itertools
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, decompressed
from tomo.grid import VoxelGrid
from tomo.io._axes import in_order, numbers_in

_NUMBERS = {
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4",
    "Int64": "i8", "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
_SIZES = {"UInt32": "u4", "UInt64": "u8"}  # types of the byte counts before the values
_ORDERS = {"LittleEndian": "<", "BigEndian": ">"}
_OPENING = re.compile(rb"<AppendedData[^>]*+>\s*+_")


def write(
    path: Path,
    data: NDArray[np.float32],
    grid: VoxelGrid,
    length_unit: str,
    value_unit: str,
) -> None:
    """Write ``data`` as point data whose points are the voxels' centres."""
    extent = " ".join(f"0 {n - 1}" for n in grid.shape)
    origin = " ".join(repr(float(x)) for x in grid.origin)
    spacing = " ".join(repr(float(x)) for x in grid.spacing)
    units = {"length_unit": length_unit} | ({"value_unit": value_unit} if value_unit else {})
    head = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n'
        "    <FieldData>\n" + "".join(map(_text, units, units.values())) + "    </FieldData>\n"
        f'    <Piece Extent="{extent}">\n'
        '      <PointData Scalars="emission">\n'
        '        <DataArray type="Float32" Name="emission" format="appended" offset="0"/>\n'
        "      </PointData>\n"
        "    </Piece>\n"
        "  </ImageData>\n"
        '  <AppendedData encoding="raw">\n_'
    )
    with path.open("wb") as file:
        file.write(head.encode())
        file.write(np.array(data.nbytes, "<u8").tobytes())
        for iz in range(grid.shape[2]):  # slice by slice: x is the fastest axis on disk
            file.write(np.asfortranarray(data[:, :, iz], dtype="<f4").tobytes(order="F"))
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")


def _text(name: str, text: str) -> str:
    """Return an array of field data with one string."""
    codes = " ".join(str(byte) for byte in (*text.encode(), 0))
    return (
        f'      <Array type="String" Name="{name}" NumberOfTuples="1" format="ascii">'
        f"{codes}</Array>\n"
    )


def read(path: Path) -> tuple[NDArray, NDArray, NDArray, str, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and both units."""
    content = path.read_bytes()
    appended = b""
    opening = _OPENING.match(content, max(content.find(b"<AppendedData"), 0))
    if opening:  # raw bytes are no XML: cut them out before parsing
        closing = content.rfind(b"</AppendedData>")
        if closing < opening.end():
            raise ValueError("found no end of AppendedData, expected one: truncated")
        appended = content[opening.end() : closing]
        content = content[: opening.end() - 1] + content[closing:]
    root = ElementTree.fromstring(content)  # expat itself limits what entities expand to
    image, piece = root.find("ImageData"), root.find("ImageData/Piece")
    if root.get("type") != "ImageData" or image is None or piece is None:
        raise ValueError(
            f"found VTK XML of type {root.get('type')}, expected ImageData with one Piece"
        )
    direction = _numbers(image, "Direction", 9, "1 0 0 0 1 0 0 0 1").reshape(3, 3)
    first, last = _numbers(piece, "Extent", 6, "", np.int64).reshape(3, 2).T
    spacing = _numbers(image, "Spacing", 3, "1 1 1")
    steps = direction.T * spacing[:, None]
    origin = _numbers(image, "Origin", 3, "0 0 0") + first @ steps
    shape = last - first + 1
    array = piece.find("PointData/DataArray")
    if array is None:
        array = piece.find("CellData/DataArray")
        shape, origin = shape - 1, origin + steps.sum(axis=0) / 2
    if array is None:
        raise ValueError("found no DataArray, expected one in PointData or CellData")
    if array.get("NumberOfComponents", "1") != "1":
        raise ValueError("found several components a voxel, expected one")
    values = _values(root, array, appended)
    if (shape < 1).any() or values.size != np.prod(shape):
        raise ValueError(f"found {values.size} values, expected {' x '.join(map(str, shape))}")
    units = _field_text(image, "length_unit") or "mm", _field_text(image, "value_unit")
    values = values.reshape(shape, order="F")
    return *in_order(values, origin, steps, "Direction", spacing), *units


def _field_text(image: ElementTree.Element, name: str) -> str:
    """Return a string of the field data; empty without one."""
    array = image.find(f"FieldData/Array[@Name='{name}']")
    codes = [] if array is None else [int(code) for code in (array.text or "").split()]
    return bytes(code for code in codes if code).decode()


def _numbers(
    element: ElementTree.Element, name: str, count: int, default: str, dtype: type = np.float64
) -> NDArray:
    """Return the numbers of an attribute."""
    return numbers_in(element.get(name, default), name, count, dtype)


def _known(
    element: ElementTree.Element, name: str, meanings: Mapping[str, str], default: str = ""
) -> str:
    """Return the meaning of an attribute's word."""
    word = element.get(name, default)
    if word not in meanings:
        raise ValueError(f"{name}: found {word[:60]!r}, expected one of {', '.join(meanings)}")
    return meanings[word]


def _values(root: ElementTree.Element, array: ElementTree.Element, appended: bytes) -> NDArray:
    own = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    order = _known(root, "byte_order", _ORDERS, own)
    dtype = np.dtype(order + _known(array, "type", _NUMBERS))
    header = np.dtype(order + _known(root, "header_type", _SIZES, "UInt32"))
    if array.get("format") == "ascii":
        return np.fromstring(array.text or "", np.float64, sep=" ")
    if array.get("format") == "appended":
        (offset,) = _numbers(array, "offset", 1, "0", np.int64)
        element = root.find("AppendedData")
        if element is None or not 0 <= offset < len(appended):
            raise ValueError(
                f"offset: found {offset}, expected one inside the {len(appended)} bytes appended"
            )
        encoded, is_raw = appended[offset:], element.get("encoding") == "raw"
    else:
        encoded, is_raw = (array.text or "").strip().encode(), False
    compressor = root.get("compressor")
    if compressor not in (None, "", "vtkZLibDataCompressor"):
        raise ValueError(f"found compressor {compressor}, expected vtkZLibDataCompressor or none")
    take = _take_raw if is_raw else _take_base64
    if not compressor:
        count = int(np.frombuffer(take(encoded, header.itemsize), header)[0])
        payload = take(encoded, header.itemsize + count)[header.itemsize :]
        return np.frombuffer(payload, dtype)
    # zlib: number of blocks, block size, size of the last block, then each compressed size
    blocks = int(np.frombuffer(take(encoded, header.itemsize), header)[0])
    head_size = (3 + blocks) * header.itemsize
    _, each, last, *sizes = np.frombuffer(take(encoded, head_size), header).tolist()
    counts = [each] * (blocks - 1) + [last or each]
    check_claim(sum(counts), len(encoded))
    encoded = encoded[head_size if is_raw else -(-head_size // 3) * 4 :]
    payload = take(encoded, sum(sizes))
    stops = itertools.accumulate(sizes)
    parts = (payload[stop - size : stop] for stop, size in zip(stops, sizes, strict=True))
    return np.frombuffer(b"".join(map(decompressed, parts, counts)), dtype)


def _take_raw(encoded: bytes, count: int) -> bytes:
    if not 0 <= count <= len(encoded):
        raise ValueError(f"found {len(encoded)} bytes, expected {count}: truncated")
    return encoded[:count]


def _take_base64(encoded: bytes, count: int) -> bytes:
    decoded = base64.b64decode(encoded[: -(-max(count, 0) // 3) * 4])
    return _take_raw(decoded, count)
