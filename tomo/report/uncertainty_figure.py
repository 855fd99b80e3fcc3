"""The figures of the uncertainty report: the volume and, beside it, how uncertain it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw.emission import COLOURS
from tomo.draw.figures import new_figure
from tomo.draw.scene import ColourScale
from tomo.draw.volume.planes import middle_planes, planes_row, row_size
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_deviations(
    volume: NDArray,
    deviation: NDArray | None,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    value_unit: str = "",
    title: str = "Standard deviation",
) -> Figure:
    """Return the middle planes of a volume and, beside them, of its standard deviation, if any.

    Parameters
    ----------
    volume, deviation : (nx, ny, nz)
        In one unit; each has a colour scale of its own. The second may be None.
    grid : VoxelGrid
    length_unit, value_unit : str
    title : str
        The name of ``deviation``.

    Raises
    ------
    ValueError
        If a shape is not the grid's.
    """
    shown = [("Emission", volume), *([] if deviation is None else [(title, deviation)])]
    for name, values in shown:
        if values.shape != grid.shape:
            raise ValueError(f"{name}: found shape {values.shape}, expected {grid.shape}")
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    inches = min(3.0 / wide.sum(), 3.6 / tall.max())
    block, height = row_size(grid, inches)
    figure = new_figure(len(shown) * block, height)
    for number, (name, values) in enumerate(shown):
        clean = np.nan_to_num(values)
        highest = max(float(plane[0].max()) for plane in middle_planes(clean, grid)) or 1.0
        scale = ColourScale(value_unit, 0.0, highest, COLOURS)
        corner = number * block, height
        planes_row(
            figure, corner, inches, clean, grid, scale, heading=name, length_unit=length_unit
        )
    return figure
