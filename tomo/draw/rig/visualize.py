"""A rig in a file to look at: its cameras with the volume, and how well they cover it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from rigs import Rig
from rigs.check import check_rig
from rigs.check.compare import RigDifference
from rigs.check.result import RigCheck
from tomo.draw.emission import LIGHT, Looks
from tomo.draw.figures import FIGURE_SUFFIXES, save_figure, suffix_of
from tomo.draw.rig.camera_view import camera_views
from tomo.draw.rig.rig_page import (
    check_table,
    compare_on_grid,
    coverage_maps,
    coverage_scene,
    difference_table,
    draw_coverage,
    other_rig_scene,
)
from tomo.draw.rig.rig_scene import Target, grid_of, rig_scene, up_of
from tomo.draw.rig.surroundings import target_scene
from tomo.draw.rig.thumbnails import image_scene, load_thumbnails
from tomo.draw.scene import Scene
from tomo.draw.stage import Shown
from tomo.draw.volume.isosurface import LEVELS, isosurface_scene
from tomo.draw.volume.visualize import volume_of
from tomo.draw.writers import Table, write_glb, write_html
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rigs import Volume
    from tomo.draw.volume.visualize import GivenVolume
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
    other: Rig | RigDifference | None = None,
    names: tuple[str, str] = NAMES,
    coverage: bool = True,
    title: str = "",
    looks: Looks = LIGHT,
) -> None:
    """Draw a rig's cameras and the volume that they look at, as ``flametomo visualize-rig``.

    Parameters
    ----------
    path : path-like
        A .png, .pdf, .svg, .html or .glb file to write.
    rig : Rig
    grid : VoxelGrid, optional
        The volume's, else the rig's own when None.
    volume : Reconstruction, DataArray, (nx, ny, nz) array or path-like, optional
        Shown in its place.
    images : Scan, path-like or mapping, optional
        A scan, a folder of images, or camera to picture ``(rows, columns)`` uint8, as of
        `tomo.draw.rig.thumbnails.load_thumbnails`, which .html and .glb show.
    frame : str, optional
        The moment of the images; the first when None.
    other : Rig or RigDifference, optional
        Another rig of the same cameras, drawn too; and how both differ, in .html.
    names : (str, str)
        What both are called.
    coverage : bool
        Whether .html has maps of views, resolved details and pixel size.
    looks : Looks
        Of the volume.

    Raises
    ------
    ValueError
        If the suffix is another, there is no camera, or a volume or images do not belong to it.
    """
    suffix, title = suffix_of(path), title or Path(path).stem
    if not len(rig):
        raise ValueError("cameras: found none, expected at least one to draw")
    shown = None if volume is None else volume_of(volume, grid, rig.length_unit)
    if shown is not None and shown.length_unit != rig.length_unit:
        raise ValueError(
            f"volume: length unit: found {shown.length_unit!r}, expected {rig.length_unit!r}"
        )
    grid = shown.grid if shown is not None else grid_of(rig, grid)
    if isinstance(other, Rig):
        other = compare_on_grid(rig, other, grid)
    around = target_scene(rig) + (other_rig_scene(rig, other, grid) if other else Scene())
    if suffix in FIGURE_SUFFIXES:
        from tomo.draw.rig.rig_picture import draw_rig

        around = around.without("other names")  # the first rig has the same
        save_figure(draw_rig(rig, grid, shown, title=title, extra=around, looks=looks), path)
        return
    page = RigPage(rig, grid, _pictures(rig, images, frame), title)
    # a page draws the light of a volume, a file for 3-D programs its surfaces
    if suffix == ".glb":
        if shown is not None:
            around += isosurface_scene(shown, looks.levels or LEVELS)
        write_glb(path, page.scene + around)
        return
    tables = [difference_table(other, rig.length_unit, *names)] if other else []
    if coverage and grid is not None:
        check = check_rig(rig, grid)
        around += coverage_scene(coverage_maps(check))
        tables.append(check_table(check))
    light = None if shown is None else Shown((shown,), looks=looks, up=up_of(rig))
    page.write(path, around, light, tables, ["images"] * bool(page.pictures))


def visualize_check(
    path: str | os.PathLike,
    check: RigCheck,
    *,
    images: Images | None = None,
    title: str = "",
) -> None:
    """Draw maps of how well a rig covers a volume, as ``flametomo check-rig -o``.

    Parameters
    ----------
    path : path-like
        A .png, .pdf, .svg, .html or .glb file to write.
    check : RigCheck
        Of `rigs.check_rig`.
    images
        See `visualize_rig`; shown in .html.

    Raises
    ------
    ValueError
        If the suffix is another, or the check is of points that are no voxels' centres.
    """
    suffix, title, rig = suffix_of(path), title or Path(path).stem, check.coverage.rig
    maps, box = coverage_maps(check), cast("Volume", check.volume)
    if suffix in FIGURE_SUFFIXES:
        save_figure(draw_coverage(maps, f"{title}: {check.assessment}"), path)
        return
    grid = VoxelGrid(box.shape, box.spacing, box.center)
    is_page = suffix == ".html"
    pictures = _pictures(rig, images, None) if is_page else {}
    page = RigPage(rig, grid, pictures, title)
    if is_page:
        shown = ["map: details"]
        page.write(path, coverage_scene(maps), None, [check_table(check)], shown, close_up=True)
    else:  # planes of several maps would lie in each other: a file without switches holds one
        write_glb(path, page.scene + coverage_scene(maps[:1]))


@dataclass(frozen=True, eq=False)
class RigPage:
    """The page of a rig: its scene, and pictures by camera, ``(rows, columns)`` uint8."""

    rig: Rig
    grid: VoxelGrid | None = None
    pictures: Mapping[str, NDArray] = field(default_factory=dict)
    title: str = ""

    @property
    def scene(self) -> Scene:
        """The rig with what its cameras saw."""
        scene = rig_scene(self.rig, self.grid)
        if not self.pictures:
            return scene
        return scene + image_scene(self.rig, Target.of(self.rig, self.grid), self.pictures)

    def write(
        self,
        path: str | os.PathLike,
        around: Scene,
        shown: Shown | None = None,
        tables: Sequence[Table] = (),
        visible: Sequence[str] = (),
        close_up: bool = False,
    ) -> None:
        """Write it with what is ``around`` the rig; for the rest see `stage` and `write_html`."""
        write_html(
            path,
            self.scene + around,
            title=self.title,
            up=up_of(self.rig),
            grid=self.grid,
            shown=shown,
            views=camera_views(self.rig, self.grid, self.pictures),
            tables=tables,
            visible=visible,
            close_up=close_up,
        )


def _pictures(rig: Rig, images: Images | None, frame: str | None) -> Mapping[str, NDArray]:
    """Return thumbnails by camera; none without images."""
    if images is None or isinstance(images, Mapping):
        return images or {}
    return load_thumbnails(rig, images, frame)
