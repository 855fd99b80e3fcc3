"""NRRD: headers by pynrrd; the values are read here, never more of them than the header says."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.archives import inflated, unzipped
from tomo.grid import VoxelGrid

_HEADER = 1 << 16  # bytes that a header may have
_TYPES = {
    "i1": "signed char, int8, int8_t",
    "u1": "uchar, unsigned char, uint8, uint8_t",
    "i2": "short, short int, signed short, signed short int, int16, int16_t",
    "u2": "ushort, unsigned short, unsigned short int, uint16, uint16_t",
    "i4": "int, signed int, int32, int32_t",
    "u4": "uint, unsigned int, uint32, uint32_t",
    "i8": "longlong, long long, long long int, signed long long, signed long long int, int64, "
    "int64_t",
    "u8": "ulonglong, unsigned long long, unsigned long long int, uint64, uint64_t",
    "f4": "float",
    "f8": "double",
}
_NUMBERS = {name: code for code, names in _TYPES.items() for name in names.split(", ")}
_ORDERS = {"little": "<", "big": ">"}
_TEXT, _RAW = ("ascii", "ASCII", "text", "txt"), ("raw",)
_UNPACK = {"gzip": inflated, "gz": inflated, "bzip2": unzipped, "bz2": unzipped}


def write(
    path: Path,
    data: NDArray[np.float32],
    grid: VoxelGrid,
    length_unit: str,
    is_packed: bool = True,
) -> None:
    """Write ``data`` whose spatial origin is the centre of voxel (0, 0, 0)."""
    import nrrd

    unit = length_unit.replace("µ", "u").replace("μ", "u")  # NRRD headers are ASCII
    header = {
        "space": "3D-right-handed",
        "space directions": np.diag(grid.spacing),
        "space origin": grid.origin,
        "space units": [unit] * 3,
        "kinds": ["domain"] * 3,
        "encoding": "gzip" if is_packed else "raw",
    }
    nrrd.write(str(path), data, header, compression_level=1, index_order="F")


def read(path: Path) -> tuple[NDArray, NDArray, NDArray, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and length unit."""
    import nrrd

    content = path.read_bytes()
    if not content:
        raise ValueError("the file is empty")
    file = io.BytesIO(content[:_HEADER])
    with np.errstate(invalid="ignore"):  # whole numbers too large are refused below
        header = nrrd.read_header(file)
    if "data file" in header or "datafile" in header:
        raise ValueError("the values are in another file, expected them in this one")
    for field in ("type", "dimension", "sizes", "encoding"):
        if field not in header:
            raise ValueError(f"{field}: missing in the header")
    sizes = _sizes(content[: file.tell()])
    if len(sizes) != 3 or header["dimension"] != 3:
        raise ValueError(f"sizes: found {sizes[:4]}, expected three whole numbers >= 1")
    data = _values(header, content[file.tell() :], math.prod(sizes))
    data = data.reshape(sizes, order="F")  # data[ix, iy, iz]: x is the fastest axis on disk
    if "space directions" in header:
        directions = np.asarray(header["space directions"], np.float64)
        spacing = np.diagonal(directions)
        if directions.shape != (3, 3) or (directions != np.diag(spacing)).any():
            raise ValueError(
                f"space directions: found {directions.tolist()}, expected axes along x, y and z"
            )
    else:
        spacing = header.get("spacings", np.ones(3))
    units = header.get("space units") or ["mm"]
    return data, header.get("space origin", np.zeros(3)), spacing, str(units[0])


def _sizes(header: bytes) -> list[int]:
    """Return the numbers of voxels as they are written: pynrrd cuts off what is behind a point."""
    lines = (line.partition(":") for line in header.decode("ascii", "ignore").split("\n"))
    written = next(value for field, _, value in lines if field.strip() == "sizes")
    sizes = [float(word) for word in written.removeprefix("=").split()]
    if not all(size.is_integer() and size >= 1 for size in sizes):
        found = ", ".join(f"{size:.12g}" for size in sizes[:4])
        raise ValueError(f"sizes: found [{found}], expected three whole numbers >= 1")
    return [int(size) for size in sizes]


def _values(header: dict[str, Any], content: bytes, count: int) -> NDArray:
    """Return the ``count`` values behind a header."""
    encoding = header["encoding"]
    lines, skip = (
        header.get(f"{name} skip", header.get(f"{name}skip", 0)) for name in ("line", "byte")
    )
    at = 0
    for _ in range(lines):
        at = content.find(b"\n", at) + 1
        if not at:
            raise ValueError(f"line skip: found {lines}, expected no more lines than there are")
    content = content[at:]
    if lines < 0 or skip < -1:
        raise ValueError(f"line skip, byte skip: found {lines}, {skip}, expected 0 or more")
    if encoding in _TEXT:
        return _counted(np.fromstring(content[max(skip, 0) :], np.float64, sep=" "), count)
    code = np.dtype(_known(header, "type", _NUMBERS))
    if code.itemsize > 1:
        code = code.newbyteorder(_known(header, "endian", _ORDERS))
    size = count * code.itemsize
    if encoding in _RAW:
        content = content[-size:] if skip == -1 else content[skip : skip + size]
    elif encoding in _UNPACK:
        content = _UNPACK[encoding](content, size + max(skip, 0))[max(skip, 0) :]
    else:
        raise ValueError(f"encoding: found {encoding!r}, expected raw, gzip, bzip2 or ascii")
    return _counted(np.frombuffer(content, code, count=len(content) // code.itemsize), count)


def _known(header: Mapping[str, Any], field: str, meanings: Mapping[str, str]) -> str:
    """Return what the word in a field means."""
    word = header.get(field)
    if word not in meanings:
        raise ValueError(f"{field}: found {word!r}, expected one of {', '.join(meanings)}")
    return meanings[word]


def _counted(values: NDArray, count: int) -> NDArray:
    if values.size != count:
        raise ValueError(f"found {values.size} values, expected {count}: truncated or damaged")
    return values
