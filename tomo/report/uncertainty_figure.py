"""The figures of the uncertainty report: the volume and, beside it, how uncertain it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw.figures import INK, MUTED, new_figure, plain, short_numbers
from tomo.draw.volume.planes import coordinate, middle_planes, show_plane
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = "inferno"
_LEFT, _BETWEEN, _BAR, _BOTTOM, _TOP = 0.62, 0.58, 0.95, 0.5, 0.75  # inches


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
    extent = grid.extent
    widths, heights = extent[[0, 2, 0]], extent[[1, 1, 2]]
    inches = min(3.0 / widths.sum(), 3.6 / heights.max())
    block = _LEFT + widths.sum() * inches + 2 * _BETWEEN + _BAR
    size = len(shown) * block, heights.max() * inches + _BOTTOM + _TOP
    figure = new_figure(*size)
    for number, (name, values) in enumerate(shown):
        planes = middle_planes(np.nan_to_num(values), grid)
        highest = max(float(plane[0].max()) for plane in planes) or 1.0
        left = number * block + _LEFT
        figure.text(
            left / size[0], 1 - 0.25 / size[1], name, fontsize=9.5, color=INK, weight="bold"
        )
        for plane, width, height in zip(planes, widths * inches, heights * inches, strict=True):
            bottom = size[1] - _TOP - height
            rect = (left / size[0], bottom / size[1], width / size[0], height / size[1])
            axes = figure.add_axes(rect)
            image = show_plane(
                axes, plane, length_unit, lowest=0.0, highest=highest, colours=_COLOURS
            )
            axes.locator_params(nbins=3)
            axes.set_title(
                plain(f"{'xyz'[plane[1][2]]} = {coordinate(plane[3], plane[2])}"),
                fontsize=6.5,
                color=MUTED,
                pad=3,
            )
            left += width + _BETWEEN
        tallest = heights.max() * inches
        rect = (
            (left - 0.45) / size[0],
            (size[1] - _TOP - tallest) / size[1],
            0.1 / size[0],
            tallest / size[1],
        )
        bar = figure.add_axes(rect)
        figure.colorbar(image, cax=bar)
        bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
        short_numbers(bar)
        bar.set_ylabel(plain(value_unit), fontsize=6.5, color=INK)
    return figure
