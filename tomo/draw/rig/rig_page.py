"""Tables and maps of a rig's page, and the layers of a second rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rigs import Rig
from rigs.check import compare_rigs
from rigs.check.compare import RigDifference
from rigs.check.result import RigCheck
from rigs.check.rig_check import centers_of, lattice
from tomo.draw import shapes
from tomo.draw.rig.rig_scene import Target, rig_scene, typical_distance
from tomo.draw.scene import ColourScale, Mesh, Scene, rgb
from tomo.draw.volume.planes import Slices, draw_slices, map_scene
from tomo.draw.writers import Table
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OTHER, _MOVED = rgb("#8a3fa0"), rgb("#d4148c")
_NO_FIGURE = "–"
_COARSER = "details coarser without it by (voxels)"
COARSER_IN_WORDS = (
    "Details coarser without it: by how much the size down to which 90 % of all details are "
    "measured would grow without this camera; 0 where the others see as much. Nearest other view: "
    "cameras that face each other see along one line."
)
_COMPARED = 500  # points of a volume at which two rigs are compared


_BAD = "YlOrRd"  # more is worse


def compare_on_grid(
    rig: Rig, other: Rig, grid: VoxelGrid | None = None, *, align: bool = True
) -> RigDifference:
    """Return `rigs.compare_rigs` at points of a grid, without one at what the first looks at."""
    if grid is not None:
        points = centers_of(lattice(grid, _COMPARED))
    else:
        points = Target.of(rig, None).center[None]
    return compare_rigs(rig, other, points, align=align)


def check_table(check: RigCheck) -> Table:
    """Return the assessment, the findings, and a row of figures for each camera."""
    unit = check.coverage.rig.length_unit
    lines = [("", f"Assessment: {check.assessment}"), ("", COARSER_IN_WORDS)]
    for finding in check.findings:
        names = some_names(finding.cameras)
        lines.append((finding.level, f"{names}: {finding.text}" if names else finding.text))
    columns = [
        ("camera", [one.name for one in check.cameras]),
        (f"distance ({unit})", [number(one.distance) for one in check.cameras]),
        ("field of view (°)", [number(one.field_of_view, 3) for one in check.cameras]),
        ("sees of the volume", [f"{one.sees:.1%}" for one in check.cameras]),
        ("pixel (voxels)", [number(one.footprint_in_voxels, 3) for one in check.cameras]),
        ("blur (pixels)", [number(one.blur_in_pixels, 2) for one in check.cameras]),
        ("nearest other view (°)", [number(one.nearest_view, 3) for one in check.cameras]),
        (_COARSER, [
            number(round(one.wavelength_without / check.voxel, 2), 2) for one in check.cameras
        ]),
        (f"ray-miss ({unit})", [number(one.ray_miss, 3) for one in check.cameras]),
    ]  # fmt: skip
    known = [column for column in columns if any(one != _NO_FIGURE for one in column[1])]
    return _table("Is this rig good enough?", lines, known)


def difference_table(difference: RigDifference, unit: str, first: str, second: str) -> Table:
    """Return how the second rig differs from the first: in words, and camera by camera."""
    lines = [
        (
            "",
            f"{second} laid over {first} by the best rigid motion: turned by "
            f"{number(difference.turn)}°, moved by {number(difference.shift)} {unit}; lengths "
            f"differ by the factor {difference.scale:.6g} (not applied)",
        ),
        ("", f"Ray-miss between both: {number(difference.ray_miss)} {unit}"),
    ]
    for names, where in (
        (difference.only_first, first),
        (difference.only_second, second),
    ):
        if names:
            lines.append(("warning", f"Only in {where}: {some_names(names)}"))
    cameras = difference.cameras
    columns = [
        ("camera", [one.name for one in cameras]),
        (f"position ({unit})", [number(one.distance) for one in cameras]),
        ("angle (°)", [number(one.angle) for one in cameras]),
        ("focal length (%)", [number(100 * one.focal_length) for one in cameras]),
        ("lens (px)", [number(one.lens) for one in cameras]),
        ("distortion (px)", [number(one.distortion) for one in cameras]),
        (f"ray-miss ({unit})", [number(one.ray_miss) for one in cameras]),
    ]
    return _table(f"{second} against {first}", lines, columns)


def _table(
    title: str, lines: list[tuple[str, str]], columns: list[tuple[str, list[str]]]
) -> Table:
    rows = tuple(zip(*(figures for _, figures in columns), strict=True))
    return Table(title, tuple(lines), tuple(title for title, _ in columns), rows)


def other_rig_scene(rig: Rig, difference: RigDifference, grid: VoxelGrid | None = None) -> Scene:
    """Return the cameras of the other rig, where the best motion puts them, and how they moved.

    Groups: ``other cameras, other names, moved``.
    """
    other = difference.second
    drawn = rig_scene(other, grid).only(["cameras", "names"])
    names = {"cameras": "other cameras", "names": "other names"}
    meshes = [replace(mesh, group=names[mesh.group], colour=_OTHER) for mesh in drawn.meshes]
    labels = [
        replace(label, group=names[label.group], colour=_OTHER, outward=-label.outward)
        for label in drawn.labels
    ]
    thick = 0.003 * typical_distance(rig, Target.of(rig, grid))
    for camera in difference.cameras:
        if camera.distance > 0:
            ends = rig[camera.name].position, other[camera.name].position
            text = f"{camera.name} moved by {number(camera.distance)} {rig.length_unit}"
            meshes.append(Mesh(text, "moved", *shapes.tubes(*ends, thick), _MOVED))
    return Scene(tuple(meshes), tuple(labels), rig.length_unit)


def some_names(names: tuple[str, ...], most: int = 6) -> str:
    """Return a list of names in words, cut where it is long."""
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    return ", ".join(names)


def number(value: float, digits: int = 4) -> str:
    """Return a figure for a table; what is rounding is zero."""
    if not math.isfinite(value):
        return _NO_FIGURE
    return f"{value:.{digits}g}" if abs(value) > 1e-9 else "0"


def coverage_maps(check: RigCheck) -> tuple[Slices, ...]:
    """Return the maps of views, resolved details, pixel size, ray-miss and, where known, blur.

    A map is NaN where there is no figure. Colours mean the same for every rig unless a figure runs
    off the scale: lengths are counted in voxels.

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
            made.append(Slices(name, volume, scale))
    return tuple(made)


def coverage_scene(maps: Sequence[Slices]) -> Scene:
    """Return every map on the grid's middle planes; groups are ``map: views`` and so on."""
    scene = Scene(length_unit=maps[0].volume.length_unit)
    for shown in maps:
        scene += map_scene(shown.volume, shown.heading, shown.scale)
    return scene


def draw_coverage(maps: Sequence[Slices], title: str) -> Figure:
    """Return the figure: a row of three middle planes for each map, all to one scale."""
    slices = [Slices(one.scale.title, one.volume, replace(one.scale, title="")) for one in maps]
    return draw_slices(slices, title=title, whole=False)
