"""A volume's picture for print: its light, middle planes and line integrals, all to scale."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.emission import COLOURS, EYE, of_integral
from tomo.draw.figures import INK, MUTED, new_figure, plain, save_figure, short_numbers, with_unit
from tomo.draw.rig.rig_scene import volume_scene
from tomo.draw.scene import Scene
from tomo.draw.shapes import box_corners
from tomo.draw.still import show_light, show_scene
from tomo.draw.viewpoint import Viewpoint
from tomo.draw.volume.isosurface import isosurface_scene
from tomo.draw.volume.planes import (
    coordinate,
    few_ticks,
    line_integrals,
    middle_planes,
    show_plane,
)
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI = 200
_THIN = 0.2  # inches: a plane, of few voxels, with no room for words inside or numbers along it
_SHORTEST_BAR = 0.7  # inches
_BAR = 0.55  # inches: a colour scale between two pictures
_APART = 4.0  # largest ratio of maxima on one scale: beyond it one picture is too faint


def draw_volume(
    data: NDArray,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    value_unit: str = "",
    title: str = "",
    supersample: int = 3,
    levels: Sequence[float] = (),
    colours: str = COLOURS,
) -> Figure:
    """Return the figure: the volume's light, three middle planes and three line integrals.

    Planes and integrals stand like the views of a technical drawing and share one scale.

    Parameters
    ----------
    data : (nx, ny, nz)
        Values at the voxels.
    grid : VoxelGrid
    length_unit : str
        Of the grid.
    value_unit : str
        Of the values; empty if unknown.
    title : str
        Stands above the picture.
    supersample : int
        Rays along each side of a pixel, for surfaces.
    levels : sequence of float
        Up to three parts of the maximum: surfaces are drawn there in place of the light.
    colours : str
        A colour map of matplotlib.

    Raises
    ------
    ValueError
        If the volume's shape is not the grid's, or no value is finite.
    """
    if data.shape != grid.shape:
        raise ValueError(f"volume: found shape {data.shape}, expected the grid's {grid.shape}")
    if not np.isfinite(data).any():
        raise ValueError("volume: found no finite value, expected at least one to draw")
    data = np.nan_to_num(np.asarray(data, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    extent = grid.extent
    block_width = extent[0] + extent[2]
    block_height = extent[1] + extent[2]
    height = 4.6
    drawn = min(height - 1.75, 3.3 * block_height / block_width) / block_height  # inches a unit
    block = max(block_width * drawn, 1.2)
    top, gap, left = 0.95, 0.30, 0.62
    lone = 3.0
    planes, integrals = middle_planes(data, grid), line_integrals(data, grid)
    # Seen along its longest edge, a flame is far brighter than from the side, and along an edge
    # of a voxel far fainter.
    scales = (1, 1, 2) if _comparable(*integrals[:2]) else (0, 1, 2)
    more = _BAR if scales[0] == 0 else 0.0
    pitch = block + left + 1.05
    width = 2 * pitch + more + lone + 0.1
    figure = new_figure(width, height, dpi=_DPI)
    place = {"x": 0.12 / width, "va": "center", "parse_math": False}
    figure.text(
        **place, y=1 - 0.24 / height, s=title or "Volume", fontsize=11, weight="bold", color=INK
    )
    sizes = " × ".join(f"{length:.4g}" for length in extent)
    counts = " × ".join(str(n) for n in grid.shape)
    values = f"values {data.min():.3g} to {data.max():.3g} {value_unit}".strip()
    words = f"{sizes} {length_unit}, {counts} voxels, {values}"
    figure.text(**place, y=1 - 0.47 / height, s=words, fontsize=8, color=MUTED)
    panel = (0.12, 0.15, lone, height - 0.82)
    _perspective(figure, panel, data, grid, length_unit, value_unit, levels, colours, supersample)
    corner = (lone + left, height - top)
    names = [
        f"{frame.NAMES[across]} = {coordinate(at, span)}" for _, (*_, across), span, at in planes
    ]
    _block(figure, corner, drawn, (gap, gap), planes, names, "Middle planes",
           with_unit("emission", value_unit), length_unit, (1, 1, 1), colours)  # fmt: skip
    corner = (lone + left + pitch, height - top)
    names = [f"along {frame.NAMES[across]}" for _, (*_, across), _, _ in integrals]
    _block(figure, corner, drawn, (gap + more, gap), integrals, names, "Line integrals",
           of_integral(value_unit, length_unit), length_unit, scales, colours)  # fmt: skip
    return figure


def write_volume_picture(
    path: str | os.PathLike,
    data: NDArray,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    value_unit: str = "",
    title: str = "",
    **looks: Any,
) -> None:
    """Write `draw_volume`'s figure as a PNG file."""
    units = {"length_unit": length_unit, "value_unit": value_unit}
    save_figure(draw_volume(data, grid, **units, title=title, **looks), path)


def _block(
    figure: Figure,
    corner: tuple[float, float],
    drawn: float,
    gaps: tuple[float, float],
    pictures: list,
    names: Sequence[str],
    heading: str,
    quantity: str,
    length_unit: str,
    scales: tuple[int, int, int],
    colours: str,
) -> None:
    """Draw three views that share their axes; ``corner`` is the upper left, in inches.

    ``gaps`` are those across and down; ``scales`` says of each view beside which of them its
    colour scale stands.
    """
    from matplotlib.ticker import MaxNLocator

    width, height = figure.get_size_inches()
    x0, y0 = corner
    spans = [(p[2][1] - p[2][0], p[2][3] - p[2][2]) for p in pictures]
    front, side, plan = ((w * drawn, h * drawn) for w, h in spans)
    rects = (
        (x0, y0 - front[1], *front),
        (x0 + front[0] + gaps[0], y0 - side[1], *side),
        (x0, y0 - front[1] - gaps[1] - plan[1], *plan),
    )
    ranges = [
        _range([one for one, its in zip(pictures, scales, strict=True) if its == scale])
        for scale in scales
    ]
    images = []
    for picture, (x, y, w, h), (lowest, highest) in zip(pictures, rects, ranges, strict=True):
        axes = figure.add_axes((x / width, y / height, w / width, h / height))
        images.append(
            show_plane(
                axes, picture, length_unit, lowest=lowest, highest=highest, colours=colours
            )
        )
        few_ticks(axes, w, h)
        _named(axes, names[len(images) - 1], min(w, h) < _THIN)
        if len(images) == 1 or w < _THIN:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
        if len(images) == 2 or h < _THIN:
            axes.set_ylabel("")
            axes.tick_params(labelleft=False)
    for number in sorted(set(scales)):
        image, (x, y, w, h), words = images[number], rects[number], quantity * (number == 1)
        tall = max(h, min(_SHORTEST_BAR, y + h - 0.1))
        rect = ((x + w + 0.1) / width, (y + h - tall) / height, 0.09 / width, tall / height)
        bar = figure.add_axes(rect)
        figure.colorbar(image, cax=bar)
        bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
        bar.set_ylabel(plain(words), fontsize=7.5, color=INK, labelpad=3)
        bar.yaxis.set_major_locator(MaxNLocator(max(2, int(tall / 0.35))))
        short_numbers(bar)
    figure.text(x0 / width, (y0 + 0.16) / height, heading, fontsize=8.5, color=INK, va="center")


def _named(axes: Axes, words: str, thin: bool) -> None:
    """Write which plane it is into its corner, or above it where it is too thin for that."""
    place, colour = ((1.0, 1.0), INK) if thin else ((0.04, 0.985), "white")
    axes.annotate(
        words, place, xycoords="axes fraction", xytext=(0, 1.5 if thin else 0),
        textcoords="offset points", fontsize=6, color=colour, va="bottom" if thin else "top",
        ha="right" if thin else "left",
    )  # fmt: skip


def _comparable(one: tuple, other: tuple) -> bool:
    """Return whether two pictures can be read on one colour scale."""
    highest = [float(np.abs(values).max()) for values, *_ in (one, other)]
    return max(highest) <= _APART * min(highest)


def _range(pictures: list) -> tuple[float, float]:
    """Return the colour scale's ends: zero is always on it."""
    highest = max(0.0, *(float(picture[0].max()) for picture in pictures), 0.0)
    lowest = min(0.0, *(float(picture[0].min()) for picture in pictures), 0.0)
    return lowest, highest if highest > lowest else lowest + 1.0


def _perspective(
    figure: Figure,
    rect: tuple,
    data: NDArray,
    grid: VoxelGrid,
    length_unit: str,
    value_unit: str,
    levels: Sequence[float],
    colours: str,
    supersample: int,
) -> None:
    """Draw the volume's light, or surfaces, in its box; ``rect`` in inches."""
    width, height = figure.get_size_inches()
    x, y, w, h = rect
    axes = figure.add_axes((x / width, y / height, w / width, h / height))
    axes.set_axis_off()
    up, size = frame.Up(), (round(w * figure.dpi), round(h * figure.dpi))
    bounds = np.stack([grid.lower, grid.upper])
    viewpoint = Viewpoint.framing(
        box_corners(*bounds), up.eye_direction(*EYE), up.vector, size,
        margins=(0.24, 0.08, 0.03, 0.12), distance=6,
    )  # fmt: skip
    box = volume_scene(grid, length_unit)
    if levels:
        scene = box + isosurface_scene(data, grid, length_unit, levels)
        show_scene(axes, scene, viewpoint, bounds, up, supersample)
        words = ", ".join(f"{100 * level:g}" for level in levels)
        axes.text(0.02, 0.98, f"Surfaces at {words} % of the maximum", fontsize=7, color=INK,
                  va="top", transform=axes.transAxes)  # fmt: skip
    else:
        show_light(
            axes, data, grid, Scene(length_unit=length_unit), viewpoint, bounds, up=up,
            supersample=supersample, value_unit=value_unit, colours=colours,
        )  # fmt: skip
