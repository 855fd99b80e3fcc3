"""Maps of how well a rig covers a volume: in the scene, and as a figure for paper."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.check.in_volume import MOST_POINTS, lattice
from tomo.draw.figures import INK, new_figure, save_figure
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.volume.maps import map_scene
from tomo.draw.volume.planes import planes_row, row_size
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
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    inches = min(3.4 / wide.sum(), 2.3 / tall.max())  # room for two side by side
    cell_width, cell_height = row_size(grid, inches)
    columns = max(1, min(len(maps), math.floor(13.0 / cell_width)))
    rows = math.ceil(len(maps) / columns)
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
        corner = column * cell_width, size[1] - 0.45 - row * cell_height
        scale = replace(shown.scale, title="")
        bar = planes_row(
            figure, corner, inches, shown.values, grid, scale,
            heading=shown.scale.title, length_unit=length_unit, whole=False,
        )  # fmt: skip
        if shown.name == "views":
            bar.locator_params(axis="y", integer=True)
    return figure


def write_coverage(
    path: str | os.PathLike, maps: Sequence[CoverageMap], grid: VoxelGrid, **options: str
) -> None:
    """Write `draw_coverage`'s figure as a PNG file."""
    save_figure(draw_coverage(maps, grid, **options), path)
