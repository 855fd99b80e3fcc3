"""Further layers and tables of a rig's page: coverage, calibration targets, a second rig."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from rigs import Rig
from rigs.check import check_rig, compare_rigs
from rigs.check.compare import RigDifference
from rigs.check.result import RigCheck
from tomo.draw import shapes
from tomo.draw.rig.coverage_maps import coverage_grid
from tomo.draw.rig.rig_scene import Target, rig_scene, typical_distance
from tomo.draw.scene import Label, Mesh, Scene, rgb
from tomo.draw.write_html import Table
from tomo.grid import VoxelGrid

_OTHER, _MOVED, _TARGET = rgb("#8a3fa0"), rgb("#d4148c"), rgb("#12826a")
_NO_FIGURE = "–"
_COARSER = "details coarser without it by (voxels)"
COARSER_IN_WORDS = (
    "Details coarser without it: by how much the size down to which 90 % of all details are "
    "measured would grow without this camera; 0 where the others see as much. Nearest other view: "
    "cameras that face each other see along one line."
)
_COMPARED = 500  # points of a volume at which two rigs are compared


def check_on_grid(rig: Rig, grid: VoxelGrid, **options: float) -> tuple[RigCheck, VoxelGrid]:
    """Return `rigs.check_rig` of a rig and a grid, and the coarse grid of its points."""
    return check_rig(rig, grid, **options), coverage_grid(grid)


def compare_on_grid(
    rig: Rig, other: Rig, grid: VoxelGrid | None = None, *, align: bool = True
) -> RigDifference:
    """Return `rigs.compare_rigs` at points of a grid, without one at what the first looks at."""
    if grid is not None:
        points = coverage_grid(grid, _COMPARED).centers().reshape(-1, 3)
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
    head = (
        "camera",
        f"distance ({unit})",
        "field of view (°)",
        "sees of the volume",
        "pixel (voxels)",
        "blur (pixels)",
        "nearest other view (°)",
        _COARSER,
        f"ray-miss ({unit})",
    )
    rows = [
        (
            figures.name,
            number(figures.distance),
            number(figures.field_of_view, 3),
            f"{figures.sees:.1%}",
            number(figures.footprint_in_voxels, 3),
            number(figures.blur_in_pixels, 2),
            number(figures.nearest_view, 3),
            number(round(figures.wavelength_without / check.voxel, 2), 2),
            number(figures.ray_miss, 3),
        )
        for figures in check.cameras
    ]
    known = [
        column for column in range(len(head)) if any(row[column] != _NO_FIGURE for row in rows)
    ]
    heads, *shown = (tuple(line[column] for column in known) for line in (head, *rows))
    return Table("Is this rig good enough?", tuple(lines), heads, tuple(shown))


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
    head = (
        "camera",
        f"position ({unit})",
        "angle (°)",
        "focal length (%)",
        "lens (px)",
        "distortion (px)",
        f"ray-miss ({unit})",
    )
    rows = [
        (
            camera.name,
            number(camera.distance),
            number(camera.angle),
            number(100 * camera.focal_length),
            number(camera.lens),
            number(camera.distortion),
            number(camera.ray_miss),
        )
        for camera in difference.cameras
    ]
    return Table(f"{second} against {first}", tuple(lines), head, tuple(rows))


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


def target_scene(rig: Rig) -> Scene:
    """Return the calibration targets as they were held, where the rig's calibration holds them.

    Reads ``calibration.target_poses``: a list of mappings with ``frame`` and ``corners``, the
    corners of the target in order, ``(N, 3)`` in the axes of ``camera``. Those of a camera that
    the rig has no more are left out, and all where the rig counts in another unit by now.
    Groups: ``targets, target names``.

    Raises
    ------
    ValueError
        If they are none of that.
    """
    meshes, labels = [], []
    summary = rig.calibration or {}
    is_same_unit = summary.get("length_unit", rig.length_unit) == rig.length_unit
    poses = (summary.get("target_poses") if is_same_unit else None) or []
    if not isinstance(poses, list | tuple):
        raise ValueError(f"calibration.target_poses: found {str(poses)[:60]!r}, expected a list")
    for index, pose in enumerate(poses):
        name, camera, border = _pose(pose, f"calibration.target_poses[{index}]")
        if camera not in rig:
            continue
        border = (border - rig[camera].t) @ rig[camera].R
        size = float(np.linalg.norm(np.ptp(border, axis=0)))
        middle = border.mean(axis=0)
        outline = shapes.polyline(border, 0.004 * size, closed=True)
        meshes += [
            Mesh(name, "targets", *outline, _TARGET),
            Mesh(name, "targets", *shapes.fan(middle, border), _TARGET, 0.12),
        ]
        labels.append(Label(name, "target names", border[0], 0.1 * (border[0] - middle), _TARGET))
    return Scene(tuple(meshes), tuple(labels), rig.length_unit)


def _pose(pose: object, what: str) -> tuple[str, str, np.ndarray]:
    """Return the names of frame and camera, and the corners ``(N, 3)`` of one target."""
    name, camera, border = "", "", np.zeros((0, 3))
    if isinstance(pose, Mapping):
        with suppress(TypeError, ValueError, KeyError):
            name, camera, border = (
                str(pose["frame"]),
                str(pose["camera"]),
                np.array(pose["corners"], np.float64),
            )
    is_outline = border.ndim == 2 and len(border) > 2 and border.shape[1] == 3
    if not (is_outline and np.isfinite(border).all()):
        raise ValueError(
            f"{what}: found {str(pose)[:60]!r}, expected frame, camera and corners (N, 3)"
        )
    return name, camera, border


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
