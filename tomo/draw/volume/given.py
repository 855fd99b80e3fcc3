"""Volumes as a caller has them: a reconstruction, an xarray, an array on a grid, a file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.io import read_volume_with_unit, volume_of_data_array
from tomo.pipeline import Reconstruction

if TYPE_CHECKING:
    from xarray import DataArray

    GivenVolume: TypeAlias = Reconstruction | DataArray | NDArray | "Volume" | str | os.PathLike


class Volume(NamedTuple):
    """A volume with its grid and both units; the length unit is empty where it is not known."""

    data: NDArray
    grid: VoxelGrid
    length_unit: str
    value_unit: str


def volume_of(given: GivenVolume, grid: VoxelGrid | None = None) -> Volume:
    """Return what was given with its grid and units.

    Parameters
    ----------
    given : Reconstruction, DataArray, (nx, ny, nz) array, Volume or path-like
    grid : VoxelGrid, optional
        Of a bare array, which has none; nothing else may come with one.

    Raises
    ------
    ValueError
        If an array has no grid or another shape, something else has two, or a file is no volume.
    """
    if isinstance(given, Volume):
        own = given
    elif isinstance(given, Reconstruction):
        own = Volume(given.volume, given.solution.grid, given.rig.length_unit, given.value_unit)
    elif isinstance(given, str | os.PathLike):
        own = Volume(*read_volume_with_unit(given, allow_nan=True))
    elif hasattr(given, "dims"):
        own = Volume(*volume_of_data_array(given))
    else:
        data = np.asarray(given)
        if grid is None or data.shape != grid.shape:
            expected = "a grid with it" if grid is None else f"the grid's {grid.shape}"
            raise ValueError(f"volume: found an array of shape {data.shape}, expected {expected}")
        return Volume(data, grid, "", "")
    if grid is not None and grid != own.grid:
        raise ValueError(f"volume: found it on {own.grid}, expected no other grid with it")
    return own
