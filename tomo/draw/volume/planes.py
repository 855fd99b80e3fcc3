"""The middle planes of a volume, drawn to scale: alone, or in a row with their colour bar."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.figures import INK, MUTED, plain, short_numbers
from tomo.draw.scene import ColourScale
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

# The three views of a technical drawing: (level axis, upright axis, axis looked along).
_VIEWS = ((0, 1, 2), (2, 1, 0), (0, 2, 1))

_THINNEST, _SHORTEST_BAR = 0.15, 0.7  # inches that can still be seen
_LEFT, _BETWEEN, _BAR, _BOTTOM, _TOP = 0.62, 0.58, 0.95, 0.5, 0.75  # inches round planes in a row


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


def row_size(grid: VoxelGrid, inches: float) -> tuple[float, float]:
    """Return width and height of `planes_row` in inches, with ``inches`` for a unit of length."""
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    width = _LEFT + np.maximum(wide * inches, _THINNEST).sum() + 2 * _BETWEEN + _BAR
    return float(width), float(max(tall.max() * inches, _THINNEST) + _BOTTOM + _TOP)


def planes_row(
    figure: Figure,
    corner: tuple[float, float],
    inches: float,
    values: NDArray,
    grid: VoxelGrid,
    scale: ColourScale,
    *,
    heading: str,
    length_unit: str,
    whole: bool = True,
) -> Axes:
    """Draw the three middle planes in a row, and their colour bar; return its axes.

    Parameters
    ----------
    figure : Figure
    corner : (float, float)
        The upper left corner of the row, in inches from the figure's lower left.
    inches : float
        For a unit of length.
    values : (nx, ny, nz)
    grid : VoxelGrid
    scale : ColourScale
        Its title stands beside the bar.
    heading, length_unit : str
    whole : bool
        Whether the outer halves of the outermost voxels are shown.
    """
    size = figure.get_size_inches()
    left, top = corner[0] + _LEFT, corner[1] - _TOP
    figure.text(
        left / size[0], (corner[1] - 0.25) / size[1], plain(heading), fontsize=9, color=INK
    )
    tallest = 0.0
    for picture in middle_planes(values, grid):
        (level, upright, across), (x0, x1, y0, y1), at = picture[1:]
        width, height = max((x1 - x0) * inches, _THINNEST), max((y1 - y0) * inches, _THINNEST)
        tallest = max(tallest, height)
        rect = left / size[0], (top - height) / size[1], width / size[0], height / size[1]
        axes = figure.add_axes(rect)
        image = show_plane(
            axes, picture, length_unit, lowest=scale.lower, highest=scale.upper,
            colours=scale.colours,
        )  # fmt: skip
        axes.set_aspect("auto")  # a line of voxels is widened until it can be seen
        if not whole:
            for axis, limits in ((level, axes.set_xlim), (upright, axes.set_ylim)):
                half = grid.spacing[axis] / 2 if grid.shape[axis] > 1 else 0.0
                limits(grid.lower[axis] + half, grid.upper[axis] - half)
        axes.set_facecolor("#cccccc")
        few_ticks(axes, width, height)
        words = f"{frame.NAMES[across]} = {coordinate(at, picture[2])}"
        axes.set_title(plain(words), fontsize=6.5, color=MUTED, pad=3)
        left += width + _BETWEEN
    tall = max(tallest, _SHORTEST_BAR)
    rect = (left - 0.45) / size[0], (top - tall) / size[1], 0.1 / size[0], tall / size[1]
    bar = figure.add_axes(rect)
    figure.colorbar(image, cax=bar)
    bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
    bar.locator_params(axis="y", nbins=max(2, int(tall / 0.35)))
    short_numbers(bar)
    bar.set_ylabel(plain(scale.title), fontsize=6.5, color=INK)
    return bar


def few_ticks(axes: Axes, width: float, height: float) -> None:
    """Set as many ticks as a plane's panel, measured in inches, has room for."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    room = room_of_number(*axes.get_xlim())
    for axis, most in ((axes.xaxis, int(width / room)), (axes.yaxis, int(height / 0.28))):
        if most > 0:
            axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
        else:  # even one step of MaxNLocator has two ends
            axis.set_major_locator(FixedLocator([sum(axis.get_view_interval()) / 2]))


def room_of_number(*ends: float) -> float:
    """Return the inches that a number takes below an axis between such ends."""
    return max(0.32, 0.03 + 0.055 * max(len(f"{end:.7g}") for end in ends))


def coordinate(at: float, extent: tuple[float, float, float, float]) -> str:
    """Return a coordinate to a thousandth of the picture's size, wherever the origin is."""
    size = max(extent[1] - extent[0], extent[3] - extent[2])
    beyond = math.ceil(math.log10(max(abs(at) / size, 1.0)))
    return f"{at:.{3 + beyond}g}"
