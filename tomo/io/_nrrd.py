"""NRRD by pynrrd: values in the file, or in one beside its header (.nhdr).

Compressed values are unpacked here, to no more than the header claims. Voxels are
placed by directions in a space, or by a spacing and ends of each axis.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import check_claim, decompressed, errors_of_libraries, largest_claim
from tomo.grid import VoxelGrid
from tomo.io._axes import HEADER, content_beside, in_order

_AGREE = 1e-3  # of a length that stands twice: files hold some four digits
_CELL, _UNKNOWN = "cell", ("???", "none", "")


def located(header: dict[str, Any], data: NDArray) -> tuple[NDArray, NDArray, NDArray, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and length unit.

    As in Teem, ends of an axis are centres of voxels, or outer faces where centering is cell.
    """
    unit = _unit(header)
    if "space directions" in header:
        origin = np.asarray(header.get("space origin", np.zeros(3)))
        if origin.shape != (3,):
            raise ValueError(f"space origin: found shape {origin.shape}, expected three numbers")
        steps = np.asarray(header["space directions"])
        return *in_order(data, origin, steps, "space directions"), unit
    spacings, mins, maxs = (_each(header, name) for name in ("spacings", "axis mins", "axis maxs"))
    axes = [
        _axis(*values)
        for values in zip(spacings, mins, maxs, _centerings(header), data.shape, strict=True)
    ]
    origin = np.array([first for first, _ in axes])
    if "space origin" in header:
        origin = header["space origin"]
    steps = np.array([step for _, step in axes])
    if any(known is not None and not known > 0 for known in spacings):
        return data, origin, steps, unit  # the grid says what is wrong with them
    return *in_order(data, np.asarray(origin), np.diag(steps), "axis mins"), unit


def _each(header: dict[str, Any], name: str) -> Sequence[float | None]:
    """Return a field's number for each axis; None where there is none."""
    found = header.get(name, header.get(name.replace(" ", "")))
    if found is None:
        return (None, None, None)
    if np.shape(found) != (3,):
        raise ValueError(f"{name}: found shape {np.shape(found)}, expected three numbers")
    numbers = [float(one) for one in found]
    if name == "spacings":
        return numbers
    return [None if math.isnan(one) else one for one in numbers]


def _centerings(header: dict[str, Any]) -> list[bool]:
    """Return for each axis whether its ends are those of cells."""
    words = header.get("centerings", header.get("centers", ()))
    words = words.split() if isinstance(words, str) else list(words)
    if any(word not in (_CELL, "node", *_UNKNOWN) for word in words) or len(words) not in (0, 3):
        raise ValueError(f"centerings: found {words[:4]}, expected cell or node for each axis")
    return [word == _CELL for word in words or ("", "", "")]


def _axis(
    spacing: float | None, low: float | None, high: float | None, of_cells: bool, count: int
) -> tuple[float, float]:
    """Return the position of the first voxel's centre and the way to the next one."""
    intervals = count if of_cells else count - 1
    if low is None or high is None:
        step = 1.0 if spacing is None else spacing
        if low is None:
            if high is None:
                return 0.0, step
            low = high - step * intervals
    else:
        if spacing is None:
            step = (high - low) / intervals if intervals else 1.0
        else:
            step = -spacing if high < low else spacing
        if not abs(high - low - step * intervals) <= _AGREE * abs(step) * max(intervals, 1):
            raise ValueError(
                f"axis maxs: found {high:g}, expected {low + step * intervals:g} by axis mins, "
                f"spacings and {'cells' if of_cells else 'nodes'}"
            )
    return low + (step / 2 if of_cells else 0.0), step


def _unit(header: dict[str, Any]) -> str:
    """Return the unit of length, one for all axes."""
    units = header.get("space units") or header.get("units") or ["mm"]
    if len(set(units)) > 1:
        raise ValueError(f"space units: found {units}, expected one unit for all axes")
    return str(units[0]) or "mm"


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
    file = io.BytesIO(content[:HEADER])
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
        most = min(np.float64().itemsize * count + max(skip, 0), largest_claim(len(content)))
        content = decompressed(content, most, method)
        header["encoding"] = "raw"
    found = f"{len(content)} bytes of type {header['type']}, encoding {header['encoding']}"
    with errors_of_libraries(f"found {found}, byte skip {skip}, expected {count} values"):
        header["byte skip"] = skip
        return nrrd.read_data(header, io.BytesIO(content), index_order="F")
