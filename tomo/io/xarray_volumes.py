"""Volumes as xarray holds them: an array with coordinates and units, in and out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import Volume, VoxelGrid
from tomo.grid.coordinates import AXES, descending
from tomo.io.volumes import check_length_unit

if TYPE_CHECKING:
    from types import ModuleType

    from xarray import DataArray


def xarray_or_pip_line() -> ModuleType:
    """Return the module xarray."""
    try:
        import xarray
    except ImportError:
        raise ValueError(
            "xarray: found no such library: install it by pip install 'flametomo[notebook]'"
        ) from None
    return xarray


def data_array(
    volume: NDArray,
    grid: VoxelGrid,
    length_unit: str = "mm",
    value_unit: str = "",
    *,
    name: str = "emission",
    more: Mapping[str, NDArray] | None = None,
    **attributes: Any,
) -> DataArray:
    """Return a volume as a DataArray, with the centres of the voxels as coordinates.

    Parameters
    ----------
    volume : (nx, ny, nz)
    grid : VoxelGrid
    length_unit, value_unit : str
        The attribute ``units`` of the coordinates and of the array.
    name : str
    more : mapping of str to (nx, ny, nz), optional
        Further values of the voxels in the same unit, which become coordinates too: they are cut
        as the array is.
    attributes
        Further attributes.

    Raises
    ------
    ValueError
        If xarray is not installed.

    Examples
    --------
    >>> data_array(np.ones((2, 1, 1)), VoxelGrid((2, 1, 1), 0.5)).x.values
    array([-0.25,  0.25])
    """
    axes = {
        axis: (axis, values, {"units": length_unit})
        for axis, values in zip(AXES, grid.axes(), strict=True)
    }
    units = {"units": value_unit} if value_unit else {}
    others = {each: (AXES, values, units) for each, values in (more or {}).items()}
    place = {"spacing": list(grid.spacing), "center": list(grid.center)}
    about = units | place | attributes
    return xarray_or_pip_line().DataArray(
        volume, dims=AXES, coords=axes | others, name=name, attrs=about
    )


def volume_of_data_array(array: DataArray) -> Volume:
    """Return the volume of a DataArray along x, y and z, with both units.

    The dimensions may have any order, and coordinates may descend. The length unit is ``mm`` where
    the coordinates name none; the unit of the values is empty where the array names none.

    Raises
    ------
    ValueError
        If it has other dimensions, coordinates that are not evenly spaced, or several units.
    """
    if set(array.dims) != set(AXES):
        found = ", ".join(map(str, array.dims)) or "none"
        more = [each for each in array.dims if each not in AXES]
        choose = f": choose one by array.isel({more[0]}=0)" if more else ""
        raise ValueError(f"volume: found the dimensions {found}, expected x, y and z{choose}")
    grid = VoxelGrid.from_xarray(array)
    units = {str(array.coords[name].attrs.get("units", "mm")) for name in AXES}
    if len(units) > 1:
        raise ValueError(
            f"coordinates: units: found {', '.join(sorted(units))}, expected one for x, y and z"
        )
    (length_unit,) = units
    check_length_unit(length_unit)
    backwards = tuple(AXES.index(name) for name in descending(array))
    data = np.flip(np.asarray(array.transpose(*AXES).values), backwards)
    return Volume(data, grid, length_unit, str(array.attrs.get("units", "")))
