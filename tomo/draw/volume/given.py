"""Volumes as a caller has them: a reconstruction, an xarray, an array on a grid, a file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tomo.grid import Volume, VoxelGrid
from tomo.io import read_volume_with_unit, volume_of_data_array
from tomo.pipeline import Reconstruction

if TYPE_CHECKING:
    from xarray import DataArray

    GivenVolume: TypeAlias = Reconstruction | DataArray | NDArray | str | os.PathLike


def volume_of(
    given: GivenVolume, grid: VoxelGrid | None = None, length_unit: str = "mm"
) -> Volume:
    """Return what was given with its grid and units.

    Parameters
    ----------
    given : Volume, Reconstruction, DataArray, (nx, ny, nz) array or path-like
    grid : VoxelGrid, optional
        Of a bare array, which has none; nothing else may come with one.
    length_unit : str
        Of a bare array.

    Raises
    ------
    ValueError
        If an array has no grid or another shape, something else has two, or a file is no volume.
    """
    if isinstance(given, Volume):
        own = given
    elif isinstance(given, Reconstruction):
        own = given.volume
    elif isinstance(given, str | os.PathLike):
        own, *_ = read_volume_with_unit(given, allow_nan=True)
    elif hasattr(given, "dims"):
        own, *_ = volume_of_data_array(given)
    else:
        data = np.asarray(given)
        if grid is None or data.shape != grid.shape:
            expected = "a grid with it" if grid is None else f"the grid's {grid.shape}"
            raise ValueError(f"volume: found an array of shape {data.shape}, expected {expected}")
        return Volume(data, grid, length_unit)
    if grid is not None and grid != own.grid:
        raise ValueError(f"volume: found it on {own.grid}, expected no other grid with it")
    return own
