"""A volume's picture for paper: middle planes, line integrals and surfaces, all to scale."""

from __future__ import annotations

import math
import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.view import frame
from tomo.view.figures import INK, MUTED, new_figure, plain, save_figure
from tomo.view.isosurface import isosurface_scene
from tomo.view.rig_scene import volume_scene
from tomo.view.shapes import box_corners
from tomo.view.still import show_scene
from tomo.view.viewpoint import Viewpoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_DPI = 200
_COLOURS = "inferno"
_THIN = 0.2  # inches: a plane, of few voxels, with no room for words inside or numbers along it
_SHORTEST_BAR = 0.7  # inches
# The three views of a technical drawing: (level axis, upright axis, axis looked along).
_VIEWS = ((0, 1, 2), (2, 1, 0), (0, 2, 1))


def middle_planes(data: NDArray, grid: VoxelGrid) -> list[tuple[NDArray, tuple, tuple, float]]:
    """Return the three planes through the grid's middle, as `_VIEWS` orders them.

    Each is ``(values (upright, level), axes, extent, coordinate)``: an odd count shows the
    middle voxels, an even one the mean of the two planes beside the middle.
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


def _oriented(plane: NDArray, level: int, upright: int) -> NDArray:
    """Return a plane, given in the order of its axes, as (upright, level)."""
    return plane.T if level < upright else plane


def _place(grid: VoxelGrid, level: int, upright: int, across: int) -> tuple[tuple, tuple, float]:
    """Return the axes, the extent for imshow, and the coordinate of a middle plane."""
    lower, upper = grid.lower, grid.upper
    extent = (lower[level], upper[level], lower[upright], upper[upright])
    return (level, upright, across), extent, float(grid.center[across])


def draw_volume(
    data: NDArray,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    title: str = "",
    supersample: int = 3,
) -> Figure:
    """Return the figure: three middle planes, three line integrals, and surfaces.

    Planes and integrals stand like the views of a technical drawing and share one scale.

    Parameters
    ----------
    data : (nx, ny, nz)
        Values at the voxels.
    grid : VoxelGrid
    length_unit : str
        Of the grid.
    title : str
        Stands above the picture.
    supersample : int
        Rays along each side of a pixel, for the surfaces.

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
    lone = 3.3
    pitch = block + left + 1.05
    width = 2 * pitch + lone + 0.1
    figure = new_figure(width, height, dpi=_DPI)
    place = {"x": 0.12 / width, "va": "center", "parse_math": False}
    figure.text(
        **place, y=1 - 0.24 / height, s=title or "Volume", fontsize=11, weight="bold", color=INK
    )
    sizes = " × ".join(f"{length:.4g}" for length in extent)
    counts = " × ".join(str(n) for n in grid.shape)
    values = f"values {data.min():.3g} to {data.max():.3g}"
    words = f"{sizes} {length_unit}, {counts} voxels, {values}"
    figure.text(**place, y=1 - 0.47 / height, s=words, fontsize=8, color=MUTED)
    blocks = (
        ("Middle planes", "emission", middle_planes(data, grid)),
        ("Line integrals", f"emission × {length_unit}", line_integrals(data, grid)),
    )
    for number, (heading, quantity, pictures) in enumerate(blocks):
        # Seen along its longest edge, a flame is far brighter than from the side.
        own_scale = number == 1
        corner = (left + number * pitch, height - top)
        _block(figure, corner, drawn, gap, pictures, heading, quantity, length_unit, own_scale)
    x = 2 * pitch + 0.05
    _surfaces(figure, (x, 0.15, lone, height - top - 0.15), data, grid, length_unit, supersample)
    figure.text(x / width, 1 - (top - 0.16) / height, "Surfaces at 15, 40 and 70 % of the maximum",
                fontsize=8.5, color=INK, va="center")  # fmt: skip
    return figure


def write_volume_picture(
    path: str | os.PathLike, data: NDArray, grid: VoxelGrid, **how: object
) -> None:
    """Write `draw_volume`'s figure as a PNG file."""
    save_figure(draw_volume(data, grid, **how), path)


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

    longest = max(len(f"{end:.7g}") for end in axes.get_xlim())
    across = max(0.32, 0.03 + 0.055 * longest)
    axes.xaxis.set_major_locator(MaxNLocator(max(1, int(width / across)), steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(max(1, int(height / 0.28)), steps=[1, 2, 5, 10]))


def coordinate(at: float, extent: tuple[float, float, float, float]) -> str:
    """Return a coordinate to a thousandth of the picture's size, wherever the origin is."""
    size = max(extent[1] - extent[0], extent[3] - extent[2])
    beyond = math.ceil(math.log10(max(abs(at) / size, 1.0)))
    return f"{at:.{3 + beyond}g}"


def _block(
    figure: Figure,
    corner: tuple[float, float],
    drawn: float,
    gap: float,
    pictures: list,
    heading: str,
    quantity: str,
    length_unit: str,
    own_scale: bool,
) -> None:
    """Draw three views that share their axes; ``corner`` is the upper left, in inches.

    With ``own_scale`` the plan view has a colour scale of its own, else all three share one.
    """
    from matplotlib.ticker import MaxNLocator

    width, height = figure.get_size_inches()
    x0, y0 = corner
    spans = [(p[2][1] - p[2][0], p[2][3] - p[2][2]) for p in pictures]
    front, side, plan = ((w * drawn, h * drawn) for w, h in spans)
    rects = (
        (x0, y0 - front[1], *front),
        (x0 + front[0] + gap, y0 - side[1], *side),
        (x0, y0 - front[1] - gap - plan[1], *plan),
    )
    ranges = [_range(pictures[:2]), _range(pictures[:2]), _range(pictures[2:])]
    if not own_scale:
        ranges = [_range(pictures)] * 3
    images = []
    for picture, (x, y, w, h), (lowest, highest) in zip(pictures, rects, ranges, strict=True):
        axes = figure.add_axes((x / width, y / height, w / width, h / height))
        images.append(
            show_plane(
                axes, picture, length_unit, lowest=lowest, highest=highest, colours=_COLOURS
            )
        )
        few_ticks(axes, w, h)
        across, at = frame.NAMES[picture[1][2]], picture[3]
        words = f"along {across}" if own_scale else f"{across} = {coordinate(at, picture[2])}"
        _named(axes, words, min(w, h) < _THIN)
        if len(images) == 1 or w < _THIN:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
        if len(images) == 2 or h < _THIN:
            axes.set_ylabel("")
            axes.tick_params(labelleft=False)
    bars = [(images[1], rects[1], quantity)]
    if own_scale:
        bars.append((images[2], rects[2], ""))
    for image, (x, y, w, h), words in bars:
        tall = max(h, min(_SHORTEST_BAR, y + h - 0.1))
        rect = ((x + w + 0.1) / width, (y + h - tall) / height, 0.09 / width, tall / height)
        bar = figure.add_axes(rect)
        figure.colorbar(image, cax=bar)
        bar.tick_params(labelsize=6.5, colors=MUTED, length=2, pad=2)
        bar.set_ylabel(plain(words), fontsize=7.5, color=INK, labelpad=3)
        bar.yaxis.set_major_locator(MaxNLocator(max(2, int(tall / 0.35))))
    figure.text(x0 / width, (y0 + 0.16) / height, heading, fontsize=8.5, color=INK, va="center")


def _named(axes: Axes, words: str, thin: bool) -> None:
    """Write which plane it is into its corner, or above it where it is too thin for that."""
    place, colour = ((1.0, 1.0), INK) if thin else ((0.04, 0.985), "white")
    axes.annotate(
        words, place, xycoords="axes fraction", xytext=(0, 1.5 if thin else 0),
        textcoords="offset points", fontsize=6, color=colour, va="bottom" if thin else "top",
        ha="right" if thin else "left",
    )  # fmt: skip


def _range(pictures: list) -> tuple[float, float]:
    """Return the colour scale's ends: zero is always on it."""
    highest = max(0.0, *(float(picture[0].max()) for picture in pictures), 0.0)
    lowest = min(0.0, *(float(picture[0].min()) for picture in pictures), 0.0)
    return lowest, highest if highest > lowest else lowest + 1.0


def _surfaces(
    figure: Figure, rect: tuple, data: NDArray, grid: VoxelGrid, length_unit: str, supersample: int
) -> None:
    """Draw the volume's surfaces in its box; ``rect`` in inches."""
    width, height = figure.get_size_inches()
    x, y, w, h = rect
    axes = figure.add_axes((x / width, y / height, w / width, h / height))
    axes.set_axis_off()
    scene = volume_scene(grid, length_unit) + isosurface_scene(data, grid, length_unit)
    up = frame.Up()
    viewpoint = Viewpoint.framing(
        box_corners(*scene.bounds),
        up.eye_direction(*frame.EYE),
        up.vector,
        (round(w * figure.dpi), round(h * figure.dpi)),
        margins=(0.2, 0.12, 0.02, 0.14),
        distance=5,
    )
    bounds = np.stack([grid.lower, grid.upper])
    show_scene(axes, scene, viewpoint, bounds, up, supersample)
