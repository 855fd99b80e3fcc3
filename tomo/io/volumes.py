"""Volumes in and out: .npz, VTK ImageData (.vti) and NRRD, the format chosen by the suffix.

Arrays (.npy), MetaImage (.mha, .mhd), headers of NRRD (.nhdr) and NIfTI (.nii, .nii.gz) are only
read. Those written store float32 values and the centre of voxel (0, 0, 0) as their origin, with x
the fastest axis where the format has an order. In .vti the values are *point* data for that
reason: VTK's origin is where the first point is, so points are voxel centres.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.files import atomic_path
from rigs.files.size_guard import errors_of_libraries, largest_claim, read_array, read_arrays
from tomo.grid import Volume, VoxelGrid
from tomo.io import _metaimage, _nifti, _nrrd, _vti

_HEADERS = 1 << 12  # bytes of a file written here that are no values, at the most


def read_volume(
    path: str | os.PathLike,
    *,
    allow_nan: bool = False,
    spacing: ArrayLike | None = None,
    center: ArrayLike | None = None,
    length_unit: str | None = None,
) -> tuple[Volume, VoxelGrid, str]:
    """Read a volume; axes that run against x, y or z, or in another order, are put in order.

    Parameters
    ----------
    path : path-like
        A ``.npz`` (keys ``data, origin, spacing, length_unit``), ``.vti`` or ``.nrrd`` file, an
        array ``(nx, ny, nz)`` in ``.npy``, ``.nhdr``, ``.mha``, ``.mhd``, or with nibabel
        ``.nii`` or ``.nii.gz``.
    allow_nan : bool
        Whether voxels may be NaN, as `tomo.pipeline.Reconstruction.volume` marks unseen ones.
    spacing : float or (3,), optional
        Edge lengths of a voxel, for ``.npy``, which holds none.
    center : (3,), optional
        The middle of such a grid; the origin by default.
    length_unit : str, optional
        The unit of such a file.

    Returns
    -------
    data : Volume
        ``(nx, ny, nz)`` float32, with both units; that of the values is empty if not named.
    grid : VoxelGrid
        The volume's.
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
    reader = _format_of(path, _READERS)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such volume file")
    given = {"spacing": spacing, "center": center, "length_unit": length_unit}
    is_bare = reader is read_array
    if is_bare and spacing is None:
        raise ValueError(
            f"{path}: spacing: missing in a .npy, expected a voxel's edge in the "
            "rig's unit, or a .npz of data, origin and spacing"
        )
    for name, value in given.items():
        if value is not None and not is_bare:
            raise ValueError(
                f"{path}: {name}: found {value} given, expected none: the file has its own grid"
            )
    with errors_of_libraries(f"{path}: not a readable volume"):
        if is_bare:
            data = _checked(reader(path))
            grid = VoxelGrid(data.shape, spacing, (0.0, 0.0, 0.0) if center is None else center)
            length_unit, value_unit = length_unit or "mm", ""
        else:
            data, origin, edges, length_unit, value_unit = reader(path)
            data = _checked(data)
            grid = VoxelGrid.from_origin(
                data.shape, _three(edges, "spacing"), _three(origin, "origin")
            )
        _check_finite(data, allow_nan)
        if np.isnan(data).all():
            raise ValueError("found NaN in every voxel, expected some finite values")
        check_length_unit(length_unit)
        _check_value_unit(value_unit)
    return Volume(data, grid, length_unit, value_unit), grid, length_unit


def readable_endings() -> tuple[str, ...]:
    """Return the endings of the volume files that can be read."""
    return tuple(_READERS)


def _checked(data: NDArray) -> NDArray[np.float32]:
    """Return single-precision values of a volume, C order."""
    if data.ndim != 3 or data.dtype.kind not in "fiub":
        raise ValueError(
            f"data: found {data.dtype} of shape {data.shape}, expected numbers of shape "
            "(nx, ny, nz)"
        )
    with np.errstate(over="ignore"):  # to infinity, which is refused later
        return np.ascontiguousarray(data, dtype=np.float32)


def write_volume(
    path: str | os.PathLike,
    data: ArrayLike,
    grid: VoxelGrid,
    length_unit: str = "mm",
    *,
    value_unit: str = "",
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
    value_unit : str
        The unit of the values, such as ``full scales per mm``; not written when empty. It stands
        in ``.npz`` as ``value_unit``, in ``.vti`` as field data, in ``.nrrd`` as ``sample units``.
    allow_nan : bool
        Whether voxels may be NaN: unseen ones.

    Raises
    ------
    ValueError
        If the suffix is unknown, the shape is not the grid's, a value is not finite in float32
        or the unit is no plain word.
    """
    path = Path(path)
    writer = _format_of(path, _WRITERS)
    data = np.asarray(data)
    if data.shape != grid.shape:
        raise ValueError(f"{path}: found volume shape {data.shape}, expected {grid.shape}")
    try:
        check_length_unit(length_unit)
        _check_value_unit(value_unit)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    with np.errstate(over="ignore"):
        data = np.ascontiguousarray(data, dtype=np.float32)
    try:
        _check_finite(data, allow_nan)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    with atomic_path(path) as temporary:
        writer(temporary, data, grid, length_unit, value_unit)
        values = temporary.stat().st_size - _HEADERS
        if data.nbytes + _HEADERS > largest_claim(values):  # no reader would take it
            writer(temporary, data, grid, length_unit, value_unit, is_packed=False)


def check_length_unit(length_unit: str) -> None:
    """Raise ValueError unless every format can hold the unit: one word, as in ``mm``."""
    if not length_unit.isprintable() or len(length_unit.split()) != 1 or '"' in length_unit:
        raise ValueError(f"length_unit: found {length_unit!r}, expected one word, like mm")


def _check_value_unit(value_unit: str) -> None:
    """Raise ValueError unless every format can hold the unit: some printable text."""
    if not value_unit.isprintable() or '"' in value_unit:
        raise ValueError(f"value_unit: found {value_unit!r}, expected text, like counts per mm")


def _three(found: ArrayLike, name: str) -> tuple[float, float, float]:
    """Return the numbers along x, y, z that a file holds."""
    array = np.asarray(found)
    if array.shape != (3,) or array.dtype.kind not in "fiu":
        raise ValueError(
            f"{name}: found {array.dtype} of shape {array.shape}, expected three numbers"
        )
    return tuple(array.astype(np.float64).tolist())


def _check_finite(data: NDArray[np.float32], allow_nan: bool) -> None:
    bad = np.isinf(data) if allow_nan else ~np.isfinite(data)
    if bad.any():
        first = tuple(np.argwhere(bad)[0].tolist())
        raise ValueError(
            f"found {bad.sum()} NaN or infinite voxels, the first at {first}, expected finite "
            "single-precision values"
        )


def _read_npz(path: Path) -> tuple:
    arrays = read_arrays(path)
    missing = [key for key in ("data", "origin", "spacing") if key not in arrays]
    if missing:
        raise ValueError(f"found no {missing[0]!r} in it, expected data, origin and spacing")
    units = str(arrays.get("length_unit", "mm")), str(arrays.get("value_unit", ""))
    return arrays["data"], arrays["origin"], arrays["spacing"], *units


def _write_npz(
    path: Path,
    data: NDArray,
    grid: VoxelGrid,
    length_unit: str,
    value_unit: str,
    is_packed: bool = True,
) -> None:
    save = np.savez_compressed if is_packed else np.savez
    units: dict[str, Any] = {"length_unit": length_unit}
    units |= {"value_unit": value_unit} if value_unit else {}
    save(path, data=data, origin=grid.origin, spacing=grid.spacing, **units)


_READERS: dict[str, Callable] = {
    ".npz": _read_npz,
    ".vti": _vti.read,
    ".nrrd": _nrrd.read,
    ".nhdr": _nrrd.read,
    ".npy": read_array,
    ".mha": _metaimage.read,
    ".mhd": _metaimage.read,
    ".nii": _nifti.read,
    ".nii.gz": _nifti.read,
}
_WRITERS: dict[str, Callable[..., None]] = {
    ".npz": _write_npz,
    ".vti": _vti.write,
    ".nrrd": _nrrd.write,
}


def _format_of(path: Path, formats: Mapping[str, Callable]) -> Callable:
    """Return the function for a file of that ending."""
    for ending, function in formats.items():
        if path.name.lower().endswith(ending):
            return function
    raise ValueError(
        f"{path}: volume format: found suffix {path.suffix!r}, expected one of "
        f"{', '.join(formats)}: a bare array can be saved by numpy.save, axes x, y, z"
    )
