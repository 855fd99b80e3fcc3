"""Gas in files: boxes of voxels in ``.npz``, and the entry that names them."""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import path_inside, read_arrays
from rigs.files.text import write_bytes
from rigs.scene.gas.extinction_volume import ExtinctionVolume
from rigs.scene.gas.gas import Gas
from rigs.scene.gas.index_volume import IndexVolume

FINE = 1e-3
"""Step of the stored numbers over the range of the index, at most: coarser ones are stairs, whose
edges bend light more than the gas does."""

_KEYS = ("data", "origin", "spacing")

_Volume = TypeVar("_Volume", IndexVolume, ExtinctionVolume)


def read_gas(
    folder: str | os.PathLike,
    length_unit: str,
    *,
    index: str | None = None,
    extinction: str | None = None,
    medium: float = 1.0,
) -> Gas:
    """Return the gas that ``scene: gas:`` of a rig.yaml names.

    Parameters
    ----------
    folder : path
        Of the rig; the files may not leave it.
    length_unit : str
        The rig's.
    index, extinction : str, optional
        Files relative to the folder, see `read_voxels`: ``n``, and ``k`` in 1 / length.
    medium : float
        The refractive index around the gas.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        In one line: the field, the file, what was found, what was expected.
    """

    def volume(
        name: str, file: str, make: Callable[[NDArray, NDArray, NDArray], _Volume]
    ) -> _Volume:
        where = f"gas: {name}"
        path = path_inside(file, Path(folder), where)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such file, which scene: {where} names")
        try:
            return make(*read_voxels(path, length_unit))
        except ValueError as error:
            raise ValueError(f"{where}: {file}: {error}") from None

    def bending(values: NDArray, lower: NDArray, spacing: NDArray) -> IndexVolume:
        _check_steps(values)
        return IndexVolume(values, lower, spacing, medium)

    return Gas(
        None if index is None else volume("index", index, bending),
        None if extinction is None else volume("extinction", extinction, ExtinctionVolume),
    )


def read_voxels(
    path: str | os.PathLike, length_unit: str
) -> tuple[NDArray[np.floating], NDArray[np.float64], NDArray[np.float64]]:
    """Return the values of a box of voxels, its lower corner and the edges of a voxel.

    Parameters
    ----------
    path : path
        A ``.npz`` with ``data (nx, ny, nz)``, the centre ``origin (3,)`` of voxel (0, 0, 0),
        ``spacing (3,)`` and perhaps ``length_unit``, as the toolkit writes volumes.
    length_unit : str
        The unit that is expected; a file that names none is taken to be in it.

    Raises
    ------
    ValueError
        If the file is not like that, or in another unit.
    """
    arrays = read_arrays(path)
    for key in _KEYS:
        if key not in arrays:
            raise ValueError(f"{key}: missing, expected data, origin and spacing")
        if arrays[key].dtype.kind not in "fiu":
            raise ValueError(f"{key}: found {arrays[key].dtype}, expected real numbers")
    unit = str(arrays.get("length_unit", length_unit))
    if unit != length_unit:
        raise ValueError(f"length_unit: found {unit}, expected {length_unit} as the rig's")
    origin, spacing = (np.asarray(arrays[key], np.float64) for key in _KEYS[1:])
    if origin.shape != (3,) or spacing.shape not in ((), (3,)):
        raise ValueError(
            f"origin, spacing: found shapes {origin.shape}, {spacing.shape}, expected (3,) each"
        )
    return arrays["data"], origin - spacing / 2, np.broadcast_to(spacing, (3,))


def write_voxels(
    gas: IndexVolume | ExtinctionVolume, path: str | os.PathLike, length_unit: str
) -> None:
    """Write a box of voxels: `read_voxels` returns its values bit by bit.

    Raises
    ------
    ValueError
        If the gas is a formula, not voxels.
    """
    if not isinstance(gas, IndexVolume | ExtinctionVolume):
        raise ValueError(f"gas: found {type(gas).__name__}, expected voxels to write to a file")
    file = io.BytesIO()
    origin = gas.lower + gas.spacing / 2
    np.savez(
        file,
        data=gas.values,
        origin=origin,
        spacing=gas.spacing,
        length_unit=np.array(length_unit),
    )
    write_bytes(path, file.getvalue())


def _check_steps(values: NDArray) -> None:
    """Raise unless the type of an index resolves what differs from voxel to voxel."""
    if values.dtype.kind != "f" or values.size == 0:
        return
    span = float(values.max()) - float(values.min())
    step = float(np.finfo(values.dtype).eps)
    if 0 < span < step / FINE:
        raise ValueError(
            f"data: found {values.dtype}, in steps of {step:.1g}, for an index that differs by "
            f"{span:.2g}, expected float64"
        )
