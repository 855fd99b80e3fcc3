"""The emission to simulate, and the voxels that its truth is stored in."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from phantoms import Field, SampledField
from tomo.grid import VoxelGrid, grid_of_rig
from tomo.io.xarray_volumes import volume_of_data_array

if TYPE_CHECKING:
    from xarray import DataArray

    from rigs import Rig


def field_and_grid(
    field: Field | DataArray, grid: VoxelGrid | None, rig: Rig
) -> tuple[Field, VoxelGrid]:
    """Return the field of an emission, and the grid: its own where none is given, else the rig's.

    Raises
    ------
    ValueError
        If a volume is in another unit of length than the rig, or no grid is known.
    """
    own = None
    if hasattr(field, "dims"):
        data, own, unit, _ = volume_of_data_array(cast("DataArray", field))
        if unit != rig.length_unit:
            raise ValueError(
                f"field: length unit: found {unit!r}, expected {rig.length_unit!r}, the rig's"
            )
        field = SampledField(data, own)
    grid = grid or own or grid_of_rig(rig)
    if grid is None:
        raise ValueError(
            "grid: found none, expected a VoxelGrid, as the rig does not say where the volume is"
        )
    return cast("Field", field), grid
