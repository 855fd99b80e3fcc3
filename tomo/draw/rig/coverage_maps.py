"""Maps of how well a rig covers a volume: in the scene, and as a figure for paper."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.check.in_volume import MOST_POINTS, lattice
from tomo.draw.figures import INK, MUTED, new_figure, plain, save_figure
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.volume.maps import map_scene
from tomo.draw.volume.planes import middle_planes
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rigs.check.result import RigCheck

_BAD = "YlOrRd"  # more is worse


@dataclass(frozen=True, eq=False)
class CoverageMap:
    """One figure of merit at points all over the volume.

    Attributes
    ----------
    name : str
    values : (nx, ny, nz) float64
        On the grid that `coverage_grid` gave; NaN where there is none.
    scale : ColourScale
    """

    name: str
    values: NDArray[np.float64]
    scale: ColourScale


def coverage_grid(grid: VoxelGrid, most: int = MOST_POINTS) -> VoxelGrid:
    """Return the coarse grid of `rigs.check.in_volume.lattice`: its centres are checked."""
    coarse = lattice(grid, most)
    return VoxelGrid(coarse.shape, coarse.spacing, coarse.center)


def coverage_maps(check: RigCheck, grid: VoxelGrid) -> tuple[CoverageMap, ...]:
    """Return the maps of views, resolved details, pixel size, ray-miss and, where known, blur.

    Colours mean the same for every rig unless a figure runs off the scale: lengths are counted in
    voxels.

    Parameters
    ----------
    check : RigCheck
        At the centres of ``grid``'s voxels, in C order.
    grid : VoxelGrid
    """
    found, voxel = check.coverage, check.voxel
    details = check.views_of_volume.at_points() / voxel
    worst = np.full(len(found.points), np.nan)
    known = np.isfinite(found.blur).any(axis=0)
    if known.any():
        worst[known] = np.nanmax(found.blur_in_pixels[:, known], axis=0)
    made = []
    for name, title, values, upper, colours in (
        ("views", "views", found.views.astype(np.float64), len(found.rig), "viridis"),
        ("details", "90 % of details measured down to (voxels)", details, 10.0, _BAD),
        ("pixel size", "median pixel size (voxels)", found.median_footprint / voxel, 2.0, _BAD),
        ("ray-miss", "expected ray-miss (voxels)", found.ray_miss / voxel, 1.0, _BAD),
        ("blur", "largest blur (pixels)", worst, 3.0, _BAD),
    ):
        if np.isfinite(values).any():
            scale = ColourScale(title, 0.0, max(float(np.nanmax(values)), upper), colours)
            made.append(CoverageMap(name, values.reshape(grid.shape), scale))
    return tuple(made)


def coverage_scene(maps: Sequence[CoverageMap], grid: VoxelGrid, length_unit: str = "mm") -> Scene:
    """Return every map on the grid's middle planes; groups are ``map: views`` and so on."""
    scene = Scene(length_unit=length_unit)
    for shown in maps:
        scene += map_scene(shown.values, grid, shown.name, shown.scale, length_unit)
    return scene


def draw_coverage(
    maps: Sequence[CoverageMap], grid: VoxelGrid, *, length_unit: str = "mm", title: str = ""
) -> Figure:
    """Return the figure: a row of three middle planes for each map, all to one scale."""
    extent = grid.extent
    widths = np.array([extent[0], extent[2], extent[0]])
    heights = np.array([extent[1], extent[1], extent[2]])
    inches = min(3.4 / widths.sum(), 2.3 / heights.max())  # room for two side by side
    columns = max(1, min(len(maps), math.floor(11.5 / (widths.sum() * inches + 2.3))))
    rows = math.ceil(len(maps) / columns)
    cell_width = float(widths.sum() * inches) + 2.3
    cell_height = float(heights.max() * inches) + 0.95
    size = max(columns * cell_width, 5.0), rows * cell_height + 0.45
    figure = new_figure(*size, dpi=200)
    figure.text(
        0.15 / size[0],
        1 - 0.25 / size[1],
        title or "Coverage",
        fontsize=11,
        weight="bold",
        color=INK,
        va="center",
        parse_math=False,
    )
    for number, shown in enumerate(maps):
        row, column = divmod(number, columns)
        corner = (column * cell_width, size[1] - 0.45 - (row + 1) * cell_height)
        _draw_map(figure, shown, grid, corner, inches, length_unit)
    return figure


def write_coverage(
    path: str | os.PathLike, maps: Sequence[CoverageMap], grid: VoxelGrid, **options: str
) -> None:
    """Write `draw_coverage`'s figure as a PNG file."""
    save_figure(draw_coverage(maps, grid, **options), path)


def _draw_map(
    figure: Figure,
    shown: CoverageMap,
    grid: VoxelGrid,
    corner: tuple[float, float],
    inches: float,
    unit: str,
) -> None:
    """Draw three planes and their colour scale; ``corner`` is the lower left one, in inches."""
    size = figure.get_size_inches()
    left, bottom = corner[0] + 0.62, corner[1] + 0.5
    tallest = grid.extent[[1, 2]].max() * inches

    def place(x: float, y: float, width: float, height: float) -> tuple:
        return x / size[0], y / size[1], width / size[0], height / size[1]

    figure.text(
        left / size[0], (bottom + tallest + 0.13) / size[1], plain(shown.scale.title),
        fontsize=8.5, color=INK, va="center",
    )  # fmt: skip
    for number, (values, (level, upright, _), extent, _) in enumerate(
        middle_planes(shown.values, grid)
    ):
        width, height = (extent[1] - extent[0]) * inches, (extent[3] - extent[2]) * inches
        axes = figure.add_axes(place(left, bottom, width, height))
        axes.imshow(
            values,
            extent=extent,
            origin="lower",
            cmap=shown.scale.colours,
            vmin=shown.scale.lower,
            vmax=shown.scale.upper,
            interpolation="nearest",
        )
        for axis, limits in ((level, axes.set_xlim), (upright, axes.set_ylim)):
            half = grid.spacing[axis] / 2 if grid.shape[axis] > 1 else 0.0
            limits(grid.lower[axis] + half, grid.upper[axis] - half)
        axes.set_facecolor("#cccccc")
        axes.tick_params(labelsize=6, colors=MUTED, length=2)
        axes.locator_params(nbins=3)
        axes.set_xlabel(plain(f"{'xyz'[level]} ({unit})"), fontsize=6.5, color=MUTED, labelpad=1)
        axes.set_ylabel("xyz"[upright], fontsize=6.5, color=MUTED, labelpad=1)
        if number == 1:  # has the upright axis of the first
            axes.set_yticks([])
            axes.set_ylabel("")
        for spine in axes.spines.values():
            spine.set(color="#9aa5b1", linewidth=0.6)
        left += width + (0.16 if number == 0 else 0.5)
    bar = figure.add_axes(place(left - 0.3, bottom, 0.1, tallest))
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    figure.colorbar(
        ScalarMappable(Normalize(shown.scale.lower, shown.scale.upper), shown.scale.colours), bar
    )
    locator = bar.yaxis.get_major_locator()
    if isinstance(locator, MaxNLocator):
        locator.set_params(integer=shown.name == "views")
    bar.tick_params(labelsize=6.5, colors=MUTED, length=2)
    bar.yaxis.get_offset_text().set_fontsize(6.5)
