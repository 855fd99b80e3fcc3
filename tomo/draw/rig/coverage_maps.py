"""Maps of how well a rig covers a volume: in the scene, and as a figure for paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rigs.check.result import RigCheck
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.volume.maps import map_scene
from tomo.draw.volume.planes import Slices, draw_slices
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BAD = "YlOrRd"  # more is worse


@dataclass(frozen=True, eq=False)
class CoverageMap:
    """One figure of merit at points all over the volume.

    Attributes
    ----------
    name : str
    values : Volume
        At the points of the check; NaN where there is none.
    scale : ColourScale
    """

    name: str
    values: Volume
    scale: ColourScale


def coverage_maps(check: RigCheck) -> tuple[CoverageMap, ...]:
    """Return the maps of views, resolved details, pixel size, ray-miss and, where known, blur.

    Colours mean the same for every rig unless a figure runs off the scale: lengths are counted in
    voxels.

    Raises
    ------
    ValueError
        If the check is of points that are no voxels' centres.
    """
    if check.volume is None or check.lattice is None:
        raise ValueError("check: found points without a volume, expected that of rigs.check_rig")
    box, found, voxel = check.lattice, check.coverage, check.voxel
    grid = VoxelGrid(box.shape, box.spacing, box.center)
    details = check.views_of_volume.at_points() / voxel
    worst = np.full(len(found.points), np.nan)
    known = np.isfinite(found.blur).any(axis=0)
    if known.any():
        worst[known] = np.nanmax(found.blur_in_pixels[:, known], axis=0)
    made = []
    for name, title, values, upper, colours in (
        ("views", "views", found.views, len(found.rig), "viridis"),
        ("details", "90 % of details measured down to (voxels)", details, 10.0, _BAD),
        ("pixel size", "median pixel size (voxels)", found.median_footprint / voxel, 2.0, _BAD),
        ("ray-miss", "expected ray-miss (voxels)", found.ray_miss / voxel, 1.0, _BAD),
        ("blur", "largest blur (pixels)", worst, 3.0, _BAD),
    ):
        if np.isfinite(values).any():
            scale = ColourScale(title, 0.0, max(float(np.nanmax(values)), upper), colours)
            volume = Volume(values.reshape(grid.shape), grid, found.rig.length_unit)
            made.append(CoverageMap(name, volume, scale))
    return tuple(made)


def coverage_scene(maps: Sequence[CoverageMap]) -> Scene:
    """Return every map on the grid's middle planes; groups are ``map: views`` and so on."""
    scene = Scene(length_unit=maps[0].values.length_unit)
    for shown in maps:
        scene += map_scene(shown.values, shown.name, shown.scale)
    return scene


def draw_coverage(maps: Sequence[CoverageMap], title: str = "") -> Figure:
    """Return the figure: a row of three middle planes for each map, all to one scale."""
    slices = [Slices(one.scale.title, one.values, replace(one.scale, title="")) for one in maps]
    return draw_slices(slices, title=title or "Coverage", whole=False)
