"""NRRD by pynrrd: values in the file, or in one beside its header (.nhdr).

Compressed values are unpacked here, to no more than the header claims.
"""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import (
    check_claim,
    decompressed,
    errors_of_libraries,
    largest_claim,
)
from tomo.grid import VoxelGrid
from tomo.io._beside import content_beside
from tomo.io._nrrd_axes import located

_HEADER = 1 << 16  # bytes of a header; a longer one takes pynrrd seconds
_WIDEST = 8  # bytes of the widest number that NRRD has
_METHODS = {"gzip": "zlib", "gz": "zlib", "bzip2": "bzip2", "bz2": "bzip2"}


def write(
    path: Path,
    data: NDArray[np.float32],
    grid: VoxelGrid,
    length_unit: str,
    value_unit: str,
    is_packed: bool = True,
) -> None:
    """Write ``data`` whose spatial origin is the centre of voxel (0, 0, 0)."""
    import nrrd

    # NRRD headers are ASCII
    unit, values = (one.replace("µ", "u").replace("μ", "u") for one in (length_unit, value_unit))
    header = {
        "space": "3D-right-handed",
        "space directions": np.diag(grid.spacing),
        "space origin": grid.origin,
        "space units": [unit] * 3,
        "kinds": ["domain"] * 3,
        "encoding": "gzip" if is_packed else "raw",
    }
    if values:
        header["sample units"] = values
    nrrd.write(str(path), data, header, compression_level=1, index_order="F")


def read(path: Path) -> tuple[NDArray, NDArray, NDArray, str, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and both units."""
    import nrrd

    content = path.read_bytes()
    if not content:
        raise ValueError("the file is empty")
    file = io.BytesIO(content[:_HEADER])
    with np.errstate(invalid="ignore"):  # whole numbers too large are refused below
        header = nrrd.read_header(file)
    name = header.pop("data file", header.pop("datafile", None))
    values = content[file.tell() :] if name is None else content_beside(path, name, "data file")
    for field in ("type", "dimension", "sizes", "encoding"):
        if field not in header:
            raise ValueError(f"{field}: missing in the header")
    sizes = _sizes(content[: file.tell()])
    if len(sizes) != 3 or header["dimension"] != 3:
        raise ValueError(f"sizes: found {sizes[:4]}, expected three whole numbers >= 1")
    data = _values(header, values, math.prod(sizes))
    return *located(header, data), str(header.get("sample units", "")).strip('"')


def _sizes(header: bytes) -> list[int]:
    """Return the numbers of voxels as they are written: pynrrd cuts off what is behind a point."""
    lines = (line.partition(":") for line in header.decode("ascii", "ignore").split("\n"))
    written = next(value for field, _, value in lines if field.strip() == "sizes")
    sizes = [float(word) for word in written.removeprefix("=").split()]
    if not all(size.is_integer() and size >= 1 for size in sizes):
        found = ", ".join(f"{size:.12g}" for size in sizes[:4])
        raise ValueError(f"sizes: found [{found}], expected three whole numbers >= 1")
    return [int(size) for size in sizes]


def _values(header: dict, content: bytes | bytearray, count: int) -> NDArray:
    """Return the values ``(nx, ny, nz)`` behind a header that claims ``count`` of them."""
    import nrrd

    check_claim(count, len(content))
    lines, skip = (
        header.pop(f"{name} skip", header.pop(f"{name}skip", 0)) for name in ("line", "byte")
    )
    if not 0 <= lines <= content.count(b"\n"):  # pynrrd reads on behind the end
        raise ValueError(f"line skip: found {lines}, expected no more lines than there are")
    content = content.split(b"\n", lines)[-1]
    method = _METHODS.get(header["encoding"])
    if method:
        most = min(_WIDEST * count + max(skip, 0), largest_claim(len(content)))
        content = decompressed(content, most, method)
        header["encoding"] = "raw"
    found = f"{len(content)} bytes of type {header['type']}, encoding {header['encoding']}"
    with errors_of_libraries(f"found {found}, byte skip {skip}, expected {count} values"):
        header["byte skip"] = skip
        return nrrd.read_data(header, io.BytesIO(content), index_order="F")
