"""The middle planes of volumes: drawn to scale with their colour bar, or as meshes of a scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.figures import INK, MUTED, new_figure, plain, short_numbers
from tomo.draw.scene import ColourScale, Mesh, Scene
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

# The three views of a technical drawing: (level axis, upright axis, axis looked along).
_VIEWS = ((0, 1, 2), (2, 1, 0), (0, 2, 1))

_THINNEST, _SHORTEST_BAR = 0.15, 0.7  # inches that can still be seen
_LEFT, _BETWEEN, _BAR, _BOTTOM, _TOP = 0.62, 0.58, 0.95, 0.5, 0.6  # inches round planes in a row

MAP = "map: "
"""Prefix of groups of which one is shown at a time, because they lie on the same planes."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane through the middle of a volume."""

    # (upright, level): the middle voxels of an odd count, else the mean of the two next to it
    values: NDArray
    axes: tuple[int, int, int]  # the level and the upright world axis, and the one looked along
    extent: tuple[float, float, float, float]  # left, right, lower, upper, in the world
    at: float  # along the third axis

    @property
    def name(self) -> str:
        """Where it is, to a thousandth of its size, wherever the origin is."""
        left, right, lower, upper = self.extent
        size = max(right - left, upper - lower)
        beyond = math.ceil(math.log10(max(abs(self.at) / size, 1.0)))
        return f"{frame.NAMES[self.axes[2]]} = {self.at:.{3 + beyond}g}"


def middle_planes(volume: Volume) -> list[Plane]:
    """Return the three planes through the grid's middle, as `_VIEWS` orders them."""
    grid, planes = volume.grid, []
    (x0, y0, z0), (x1, y1, z1) = grid.lower.tolist(), grid.upper.tolist()
    ends = ((x0, x1), (y0, y1), (z0, z1))
    for level, upright, across in _VIEWS:
        plane = _middle(volume, across)
        plane = plane.T if level < upright else plane
        extent = (*ends[level], *ends[upright])
        planes.append(Plane(plane, (level, upright, across), extent, float(grid.center[across])))
    return planes


def _middle(values: Volume, across: int) -> NDArray:
    n = values.shape[across]
    return np.take(values, [(n - 1) // 2, n // 2], axis=across).mean(axis=across)


@dataclass(frozen=True, eq=False)
class Slices:
    """A volume of which the middle planes are drawn; the scale's title stands beside the bar."""

    heading: str
    volume: Volume
    scale: ColourScale


def draw_slices(
    shown: Sequence[Slices | None],
    *,
    columns: int | None = None,
    title: str = "",
    whole: bool = True,
) -> Figure:
    """Return the middle planes of volumes on one grid, a cell of a table each, to one scale.

    Row by row; None leaves a cell empty. There are as many columns as there is room for when None.
    ``whole`` tells whether the outer halves of the outermost voxels are shown.
    """
    grid = next(one for one in shown if one is not None).volume.grid
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    inches = min(3.2 / wide.sum(), 3.0 / tall.max())
    cell_width, cell_height = row_size(grid, inches)
    columns = columns or max(1, min(len(shown), math.floor(13.0 / cell_width)))
    width = max(columns * cell_width, 5.0 * bool(title))
    tall = math.ceil(len(shown) / columns) * cell_height
    height = tall + 0.45 * bool(title)
    figure = new_figure(width, height)
    figure.text(0.15 / width, 1 - 0.25 / height, title, fontsize=11, weight="bold",
                color=INK, va="center", parse_math=False)  # fmt: skip
    for number, one in enumerate(shown):
        row, column = divmod(number, columns)
        if one is not None:
            corner = column * cell_width, tall - row * cell_height
            planes_row(figure, corner, inches, one, whole=whole)
    return figure


def row_size(grid: VoxelGrid, inches: float) -> tuple[float, float]:
    """Return width and height of `planes_row` in inches, with ``inches`` for a unit of length."""
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    width = _LEFT + np.maximum(wide * inches, _THINNEST).sum() + 2 * _BETWEEN + _BAR
    return float(width), float(max(tall.max() * inches, _THINNEST) + _BOTTOM + _TOP)


def planes_row(
    figure: Figure, corner: tuple[float, float], inches: float, shown: Slices, whole: bool = True
) -> None:
    """Draw the three middle planes in a row, and their colour bar.

    ``corner`` is the upper left one of the row, in inches from the figure's lower left; ``inches``
    is for a unit of length. ``whole`` is as in `draw_slices`.
    """
    size, grid = figure.get_size_inches(), shown.volume.grid
    left, top = corner[0] + _LEFT, corner[1] - _TOP
    figure.text(left / size[0], (corner[1] - 0.25) / size[1], plain(shown.heading), fontsize=9,
                color=INK)  # fmt: skip
    tallest = 0.0
    for plane in middle_planes(shown.volume):
        x0, x1, y0, y1 = plane.extent
        width, height = max((x1 - x0) * inches, _THINNEST), max((y1 - y0) * inches, _THINNEST)
        tallest = max(tallest, height)
        rect = left / size[0], (top - height) / size[1], width / size[0], height / size[1]
        axes = figure.add_axes(rect)
        image = _show_plane(axes, plane, shown.scale, shown.volume.length_unit)
        if not whole:
            half = np.where(np.array(grid.shape) > 1, np.divide(grid.spacing, 2), 0.0)
            level, upright, _ = plane.axes
            axes.set_xlim(x0 + half[level], x1 - half[level])
            axes.set_ylim(y0 + half[upright], y1 - half[upright])
        _few_ticks(axes, width, height)
        left += width + _BETWEEN
    tall = max(tallest, _SHORTEST_BAR)
    rect = (left - 0.45) / size[0], (top - tall) / size[1], 0.1 / size[0], tall / size[1]
    bar = figure.add_axes(rect)
    figure.colorbar(image, cax=bar)
    bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
    are_counts = shown.volume.dtype.kind in "iu"
    bar.locator_params(axis="y", nbins=max(2, int(tall / 0.35)), integer=are_counts)
    short_numbers(bar)
    bar.set_ylabel(plain(shown.scale.title), fontsize=6.5, color=INK)


def _show_plane(axes: Axes, plane: Plane, scale: ColourScale, length_unit: str) -> AxesImage:
    """Draw one plane with ticks in world coordinates; a line of voxels is widened to be seen."""
    image = axes.imshow(
        plane.values, origin="lower", extent=plane.extent, vmin=scale.lower, vmax=scale.upper,
        cmap=scale.colours, interpolation="nearest", aspect="auto",
    )  # fmt: skip
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.tick_params(labelsize=6.5, colors=MUTED, length=2.5, pad=2)
    axes.set_facecolor("#cccccc")
    for spine in axes.spines.values():
        spine.set(color="#9aa5b1", linewidth=0.6)
    level, upright = (f"{frame.NAMES[axis]} ({plain(length_unit)})" for axis in plane.axes[:2])
    axes.set_xlabel(level, fontsize=7.5, color=INK, labelpad=2)
    axes.set_ylabel(upright, fontsize=7.5, color=INK, labelpad=1)
    axes.set_title(plain(plane.name), fontsize=6.5, color=MUTED, pad=3)
    return image


def _few_ticks(axes: Axes, width: float, height: float) -> None:
    """Set as many ticks as a plane's panel, measured in inches, has room for."""
    from matplotlib.ticker import FixedLocator, MaxNLocator

    # inches that a number takes below an axis
    room = max(0.32, 0.03 + 0.055 * max(len(f"{end:.7g}") for end in axes.get_xlim()))
    for axis, most in ((axes.xaxis, int(width / room)), (axes.yaxis, int(height / 0.28))):
        if most > 0:
            axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
        else:  # even one step of MaxNLocator has two ends
            axis.set_major_locator(FixedLocator([sum(axis.get_view_interval()) / 2]))


def map_scene(values: Volume, name: str, scale: ColourScale) -> Scene:
    """Return the three middle planes, coloured by value; the group is ``map: name``.

    A plane between two layers of voxels shows their mean.
    """
    grid, axes, meshes = values.grid, values.grid.axes(), []
    for across in range(3):
        level, upright = (axis for axis in range(3) if axis != across)
        if min(grid.shape[level], grid.shape[upright]) < 2:
            continue
        plane = _middle(values, across)
        points = np.zeros((*plane.shape, 3))
        points[..., level], points[..., upright] = np.meshgrid(
            axes[level], axes[upright], indexing="ij"
        )
        points[..., across] = grid.center[across]
        title = f"{name}, {'xyz'[across]} = {grid.center[across] + 0.0:.4g}"
        meshes.append(lattice_mesh(title, MAP + name, points, plane, scale))
    return Scene(tuple(meshes), length_unit=values.length_unit)


def lattice_mesh(
    name: str, group: str, points: NDArray, values: NDArray, scale: ColourScale
) -> Mesh:
    """Return the mesh of numbers ``(rows, columns)`` at points, one each."""
    triangles = lattice_triangles(*values.shape)
    points = points.reshape(-1, 3)
    return Mesh(name, group, points, triangles, (0.5,) * 3, values=values.ravel(), scale=scale)


def lattice_triangles(rows: int, columns: int) -> NDArray[np.int64]:
    """Return the triangles ``(T, 3)`` between the points of a lattice, numbered row by row."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, below = corner + 1, corner + columns
    return np.concatenate(
        [np.stack([corner, below, right], axis=1), np.stack([right, below, below + 1], axis=1)]
    )
