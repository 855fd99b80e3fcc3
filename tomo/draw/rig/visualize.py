"""A rig in a file to look at: its cameras with the volume, and how well they cover it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from rigs import Rig
from rigs.check.compare import RigDifference
from rigs.check.result import RigCheck
from tomo.draw.emission import LIGHT, Looks
from tomo.draw.rig.rig_page import (
    check_on_grid,
    check_table,
    compare_on_grid,
    difference_table,
    other_rig_scene,
    target_scene,
)
from tomo.draw.rig.rig_scene import Target, grid_of, rig_scene, up_of
from tomo.draw.scene import Scene
from tomo.draw.stage import Shown
from tomo.draw.suffixes import suffix_of
from tomo.draw.volume.given import volume_of
from tomo.draw.volume.isosurface import LEVELS, isosurface_scene
from tomo.draw.write_html import Table
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from tomo.draw.volume.given import GivenVolume
    from tomo.scan import Scan

    Images: TypeAlias = Scan | str | os.PathLike | Mapping[str, NDArray]

NAMES = ("the rig", "the other")


def visualize_rig(
    path: str | os.PathLike,
    rig: Rig,
    grid: VoxelGrid | None = None,
    *,
    volume: GivenVolume | None = None,
    images: Images | None = None,
    frame: str | None = None,
    pattern: str | None = None,
    other: Rig | RigDifference | None = None,
    names: tuple[str, str] = NAMES,
    coverage: bool = True,
    title: str = "",
    note: Callable[[str], None] | None = None,
    looks: Looks = LIGHT,
) -> None:
    """Draw a rig's cameras and the volume that they look at, as ``flametomo visualize-rig``.

    Parameters
    ----------
    path : path-like
        A .png, .html or .glb file to write.
    rig : Rig
    grid : VoxelGrid, optional
        The volume's, else the rig's own when None.
    volume : Reconstruction, DataArray, (nx, ny, nz) array or path-like, optional
        Shown in its place.
    images : Scan, path-like or mapping, optional
        A scan, a folder of images, or camera to picture ``(rows, columns)`` uint8, which .html
        and .glb show.
    frame, pattern : str, optional
        See `tomo.draw.rig.thumbnails.load_thumbnails`.
    other : Rig or RigDifference, optional
        Another rig of the same cameras, drawn too; and how both differ, in .html.
    names : (str, str)
        What both are called.
    coverage : bool
        Whether .html has maps of views, resolved details and pixel size.
    title : str
    note : callable, optional
        Called with lines on what image files say and reading does not heed.
    looks : Looks
        Of the volume.

    Raises
    ------
    ValueError
        If the suffix is another, there is no camera, or a volume or images do not belong to it.
    """
    suffix = suffix_of(path)
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one to draw")
    shown = None if volume is None else volume_of(volume, grid)
    if shown and shown.length_unit not in ("", rig.length_unit):
        raise ValueError(
            f"volume: length unit: found {shown.length_unit!r}, expected {rig.length_unit!r}"
        )
    grid = shown.grid if shown else grid_of(rig, grid)
    title = title or Path(path).stem
    if isinstance(other, Rig):
        other = compare_on_grid(rig, other, grid)
    around = target_scene(rig) + (other_rig_scene(rig, other, grid) if other else Scene())
    if suffix == ".png":
        from tomo.draw.rig.rig_picture import write_rig

        around = around.without("other names")  # the first rig has the same
        data, unit = (shown.data, shown.value_unit) if shown else (None, "")
        write_rig(path, rig, grid, data, title=title, extra=around, value_unit=unit, looks=looks)
        return
    pictures = _pictures(rig, images, frame, pattern, note)
    # a page draws the light of a volume, a file for 3-D programs its surfaces
    scene = _with_pictures(rig, grid, pictures) + around
    if suffix == ".glb":
        if shown:
            levels = looks.levels or LEVELS
            scene += isosurface_scene(shown.data, shown.grid, rig.length_unit, levels)
        from tomo.draw.write_glb import write_glb

        write_glb(path, scene)
        return
    tables = [difference_table(other, rig.length_unit, *names)] if other else []
    if coverage and grid is not None:
        from tomo.draw.rig.coverage_maps import coverage_maps, coverage_scene

        check, coarse = check_on_grid(rig, grid)
        scene += coverage_scene(coverage_maps(check, coarse), coarse, rig.length_unit)
        tables.append(check_table(check))
    film = shown and Shown((shown.data,), shown.grid, shown.value_unit, looks=looks)
    _write_page(path, rig, grid, scene, pictures, tables, title, film, ["images"] * bool(pictures))


def visualize_check(
    path: str | os.PathLike,
    check: RigCheck,
    *,
    images: Images | None = None,
    pattern: str | None = None,
    title: str = "",
    note: Callable[[str], None] | None = None,
) -> None:
    """Draw maps of how well a rig covers a volume, as ``flametomo check-rig -o``.

    Parameters
    ----------
    path : path-like
        A .png, .html or .glb file to write.
    check : RigCheck
        Of `rigs.check_rig`.
    images, pattern, note
        See `visualize_rig`; shown in .html.
    title : str

    Raises
    ------
    ValueError
        If the suffix is another, or the check is of points that are no voxels' centres.
    """
    from tomo.draw.rig.coverage_maps import coverage_maps, coverage_scene, write_coverage

    suffix, title, rig = suffix_of(path), title or Path(path).stem, check.coverage.rig
    if check.volume is None or check.lattice is None:
        raise ValueError("check: found points without a volume, expected that of rigs.check_rig")
    grid, coarse = (
        VoxelGrid(box.shape, box.spacing, box.center) for box in (check.volume, check.lattice)
    )
    maps, unit = coverage_maps(check, coarse), rig.length_unit
    if suffix == ".png":
        heading = f"{title}: {check.assessment}"
        write_coverage(path, maps, coarse, length_unit=unit, title=heading)
        return
    if suffix == ".glb":
        from tomo.draw.write_glb import write_glb

        # the planes of several maps would lie in each other: a file without switches holds one
        write_glb(path, rig_scene(rig, grid) + coverage_scene(maps[:1], coarse, unit))
        return
    pictures = _pictures(rig, images, None, pattern, note)
    scene = _with_pictures(rig, grid, pictures) + coverage_scene(maps, coarse, unit)
    tables, shown = [check_table(check)], ["map: details"]
    _write_page(path, rig, grid, scene, pictures, tables, title, None, shown, close_up=True)


def _pictures(
    rig: Rig,
    images: Images | None,
    frame: str | None,
    pattern: str | None,
    note: Callable[[str], None] | None,
) -> dict[str, NDArray]:
    """Return thumbnails by camera; none without images."""
    if images is None:
        return {}
    if isinstance(images, Mapping):
        return dict(images)
    from tomo.draw.rig.thumbnails import load_thumbnails

    return load_thumbnails(rig, images, frame, pattern, note=note)


def _with_pictures(rig: Rig, grid: VoxelGrid | None, pictures: dict[str, NDArray]) -> Scene:
    """Return the rig's scene with what its cameras saw."""
    scene = rig_scene(rig, grid)
    if not pictures:
        return scene
    from tomo.draw.rig.thumbnails import image_scene

    return scene + image_scene(rig, Target.of(rig, grid), pictures)


def _write_page(
    path: str | os.PathLike,
    rig: Rig,
    grid: VoxelGrid | None,
    scene: Scene,
    pictures: dict[str, NDArray],
    tables: list[Table],
    title: str,
    shown: Shown | None,
    visible: list[str],
    close_up: bool = False,
) -> None:
    from tomo.draw.rig.camera_view import camera_views
    from tomo.draw.write_html import write_html

    write_html(
        path,
        scene,
        title=title,
        up=up_of(rig),
        grid=grid,
        shown=shown,
        views=camera_views(rig, grid, pictures),
        tables=tables,
        visible=visible,
        close_up=close_up,
    )
