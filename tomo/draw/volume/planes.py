"""Flat pictures of a volume, drawn to scale: middle planes and line integrals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.figures import INK, MUTED, plain
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

# The three views of a technical drawing: (level axis, upright axis, axis looked along).
_VIEWS = ((0, 1, 2), (2, 1, 0), (0, 2, 1))


def middle_planes(data: NDArray, grid: VoxelGrid) -> list[tuple[NDArray, tuple, tuple, float]]:
    """Return the three planes through the grid's middle, as `_VIEWS` orders them.

    Each is ``(values (upright, level), axes, extent, coordinate)``: an odd count shows the
    middle voxels, an even one the mean of the two planes next to the middle.
    """
    planes = []
    for level, upright, across in _VIEWS:
        n = grid.shape[across]
        pair = np.take(data, [(n - 1) // 2, n // 2], axis=across)
        plane = pair.mean(axis=across)
        planes.append((_oriented(plane, level, upright), *_place(grid, level, upright, across)))
    return planes


def line_integrals(data: NDArray, grid: VoxelGrid) -> list[tuple[NDArray, tuple, tuple, float]]:
    """Return the volume's integrals along z, x and y (value times length), as `_VIEWS` orders."""
    sums = []
    for level, upright, across in _VIEWS:
        total = data.sum(axis=across, dtype=np.float64) * grid.spacing[across]
        sums.append((_oriented(total, level, upright), *_place(grid, level, upright, across)))
    return sums


def maximum_projections(
    data: NDArray, grid: VoxelGrid
) -> list[tuple[NDArray, tuple, tuple, float]]:
    """Return the volume's maxima along z, x and y, as `_VIEWS` orders."""
    return [
        (_oriented(data.max(axis=across), level, upright), *_place(grid, level, upright, across))
        for level, upright, across in _VIEWS
    ]


def _oriented(plane: NDArray, level: int, upright: int) -> NDArray:
    """Return a plane, given in the order of its axes, as (upright, level)."""
    return plane.T if level < upright else plane


def _place(grid: VoxelGrid, level: int, upright: int, across: int) -> tuple[tuple, tuple, float]:
    """Return the axes, the extent for imshow, and the coordinate of a middle plane."""
    lower, upper = grid.lower, grid.upper
    extent = (lower[level], upper[level], lower[upright], upper[upright])
    return (level, upright, across), extent, float(grid.center[across])


def show_plane(
    axes: Axes, picture: tuple, length_unit: str, *, lowest: float, highest: float, colours: str
) -> AxesImage:
    """Draw one plane to scale, with ticks in world coordinates."""
    values, (level, upright, _), extent, _ = picture
    image = axes.imshow(
        values,
        origin="lower",
        extent=extent,
        vmin=lowest,
        vmax=highest,
        cmap=colours,
        interpolation="nearest",
        aspect="equal",
    )
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=6.5, colors=MUTED, length=2.5, pad=2)
    for spine in axes.spines.values():
        spine.set(color="#9aa5b1", linewidth=0.6)
    length_unit = plain(length_unit)
    axes.set_xlabel(f"{frame.NAMES[level]} ({length_unit})", fontsize=7.5, color=INK, labelpad=2)
    axes.set_ylabel(f"{frame.NAMES[upright]} ({length_unit})", fontsize=7.5, color=INK, labelpad=1)
    return image


def few_ticks(axes: Axes, width: float, height: float) -> None:
    """Set as many ticks as a plane's panel, measured in inches, has room for."""
    from matplotlib.ticker import MaxNLocator

    most = max(1, int(width / room_of_number(*axes.get_xlim())))
    axes.xaxis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(max(1, int(height / 0.28)), steps=[1, 2, 5, 10]))


def room_of_number(*ends: float) -> float:
    """Return the inches that a number takes below an axis between such ends."""
    return max(0.32, 0.03 + 0.055 * max(len(f"{end:.7g}") for end in ends))


def coordinate(at: float, extent: tuple[float, float, float, float]) -> str:
    """Return a coordinate to a thousandth of the picture's size, wherever the origin is."""
    size = max(extent[1] - extent[0], extent[3] - extent[2])
    beyond = math.ceil(math.log10(max(abs(at) / size, 1.0)))
    return f"{at:.{3 + beyond}g}"
