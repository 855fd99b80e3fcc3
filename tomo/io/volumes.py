"""Volumes in and out: .npz, VTK ImageData (.vti) and NRRD, the format chosen by the suffix.

All three store float32 values and the centre of voxel (0, 0, 0) as their origin, with x the
fastest axis where the format has an order. In .vti the values are *point* data for that reason:
VTK's origin is where the first point is, so points are voxel centres.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.grid import VoxelGrid
from tomo.io import _vti
from tomo.io.atomic import atomic_path

Volume = tuple[NDArray[np.float32], VoxelGrid, str]


def read_volume(path: str | os.PathLike, *, allow_nan: bool = False) -> Volume:
    """Read a volume.

    Parameters
    ----------
    path : path-like
        A ``.npz`` (keys ``data, origin, spacing, length_unit``), ``.vti`` or ``.nrrd`` file.
    allow_nan : bool
        Whether voxels may be NaN, as `tomo.outcome.Outcome.volume` marks unseen ones.

    Returns
    -------
    data : (nx, ny, nz) float32
    grid : VoxelGrid
    length_unit : str
        ``"mm"`` where the file names none.

    Raises
    ------
    ValueError
        If the file cannot be read as a volume on axis-aligned voxels, or holds NaN or infinity.
    FileNotFoundError
        If there is no such file.
    """
    path = Path(path)
    reader, _ = _format_of(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such volume file")
    try:
        data, origin, spacing, length_unit = reader(path)
        if data.ndim != 3 or data.dtype.kind not in "fiub":
            raise ValueError(f"found {data.dtype} {data.shape}, expected numbers (nx, ny, nz)")
        with np.errstate(over="ignore"):  # too large a number is told as infinity below
            data = np.ascontiguousarray(data, dtype=np.float32)
        grid = VoxelGrid.from_origin(data.shape, spacing, origin)
        _check_finite(data, allow_nan)
    except Exception as error:  # parsers of foreign bytes may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path}: not a readable volume: {reason}") from error
    return data, grid, length_unit


def write_volume(
    path: str | os.PathLike,
    data: ArrayLike,
    grid: VoxelGrid,
    length_unit: str = "mm",
    *,
    allow_nan: bool = False,
) -> None:
    """Write a volume as ``.npz``, ``.vti`` or ``.nrrd``, whole or not at all.

    Parameters
    ----------
    path : path-like
        The suffix chooses the format.
    data : (nx, ny, nz) array
        Stored as float32.
    grid : VoxelGrid
    length_unit : str
        One short word.
    allow_nan : bool
        Whether voxels may be NaN: unseen ones.

    Raises
    ------
    ValueError
        If the suffix is unknown, the shape is not the grid's, a value is not finite in float32
        or the unit is no plain word.
    """
    path = Path(path)
    _, writer = _format_of(path)
    data = np.asarray(data)
    if data.shape != grid.shape:
        raise ValueError(f"{path}: found volume shape {data.shape}, expected {grid.shape}")
    try:
        check_length_unit(length_unit)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    with np.errstate(over="ignore"):
        data = np.ascontiguousarray(data, dtype=np.float32)
    try:
        _check_finite(data, allow_nan)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    with atomic_path(path) as temporary:
        writer(temporary, data, grid, length_unit)


def check_length_unit(length_unit: str) -> None:
    """Raise ValueError unless every format can hold the unit: one word, as in ``mm``."""
    if not length_unit.isprintable() or len(length_unit.split()) != 1 or '"' in length_unit:
        raise ValueError(f"length_unit: found {length_unit!r}, expected one word, like mm")


def _check_finite(data: NDArray[np.float32], allow_nan: bool) -> None:
    bad = np.isinf(data) if allow_nan else ~np.isfinite(data)
    if bad.any():
        first = tuple(np.argwhere(bad)[0].tolist())
        raise ValueError(f"found {bad.sum()} NaN or infinite voxels, the first at {first}")


def _read_npz(path: Path) -> tuple:
    if not zipfile.is_zipfile(path):
        raise ValueError("expected a .npz archive, found something else or a truncated one")
    with np.load(path, allow_pickle=False) as archive:
        missing = [key for key in ("data", "origin", "spacing") if key not in archive]
        if missing:
            raise ValueError(f"found no {missing[0]!r} in it, expected data, origin and spacing")
        unit = str(archive["length_unit"]) if "length_unit" in archive else "mm"
        return archive["data"], archive["origin"], archive["spacing"], unit


def _write_npz(path: Path, data: NDArray, grid: VoxelGrid, length_unit: str) -> None:
    np.savez_compressed(
        path, data=data, origin=grid.origin, spacing=grid.spacing, length_unit=length_unit
    )


def _read_nrrd(path: Path) -> tuple:
    import nrrd

    with path.open("rb") as file:
        header = nrrd.read_header(file)
        if "data file" in header or "datafile" in header:
            raise ValueError("the values are in another file, expected them in this one")
        data = nrrd.read_data(header, file)  # index order F: data[ix, iy, iz], x fastest on disk
    if "space directions" in header:
        directions = np.asarray(header["space directions"], np.float64)
        spacing = np.diagonal(directions)
        if directions.shape != (3, 3) or (directions != np.diag(spacing)).any():
            raise ValueError(
                f"space directions: found {directions.tolist()}, expected axes along x, y and z"
            )
    else:
        spacing = header.get("spacings", np.ones(3))
    units = header.get("space units", ["mm"])
    return data, header.get("space origin", np.zeros(3)), spacing, str(units[0])


def _write_nrrd(path: Path, data: NDArray, grid: VoxelGrid, length_unit: str) -> None:
    import nrrd

    unit = length_unit.replace("µ", "u").replace("μ", "u")  # NRRD headers are ASCII
    header = {
        "space": "3D-right-handed",
        "space directions": np.diag(grid.spacing),
        "space origin": grid.origin,
        "space units": [unit] * 3,
        "kinds": ["domain"] * 3,
        "encoding": "gzip",
    }
    nrrd.write(str(path), data, header, compression_level=1, index_order="F")


_FORMATS: dict[str, tuple[Callable[[Path], tuple], Callable[..., None]]] = {
    ".npz": (_read_npz, _write_npz),
    ".vti": (_vti.read, _vti.write),
    ".nrrd": (_read_nrrd, _write_nrrd),
}


def _format_of(path: Path) -> tuple[Callable, Callable]:
    try:
        return _FORMATS[path.suffix.lower()]
    except KeyError:
        expected = ", ".join(_FORMATS)
        raise ValueError(
            f"{path}: volume format: found suffix {path.suffix!r}, expected one of {expected}"
        ) from None
