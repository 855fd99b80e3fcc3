"""A volume in a file to look at: PNG for papers, HTML to turn around, GLB for viewers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from rigs.files import atomic_path
from tomo.draw.emission import LIGHT, Looks, turning_gif
from tomo.draw.figures import save_figure
from tomo.draw.scene import Scene
from tomo.draw.suffixes import TURNING, suffix_of
from tomo.draw.volume.given import volume_of
from tomo.draw.volume.isosurface import LEVELS
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    from tomo.draw.volume.given import GivenVolume


def visualize_volume(
    path: str | os.PathLike,
    volume: GivenVolume,
    grid: VoxelGrid | None = None,
    *,
    length_unit: str | None = None,
    value_unit: str | None = None,
    title: str = "",
    looks: Looks = LIGHT,
) -> None:
    """Draw a volume's light, planes and line integrals, as ``flametomo visualize-volume``.

    Parameters
    ----------
    path : path-like
        A .png, .html, .glb or .gif file to write; the last turns once around.
    volume : Reconstruction, DataArray, (nx, ny, nz) array or path-like
    grid : VoxelGrid, optional
        Of a bare array.
    length_unit, value_unit : str, optional
        The volume's own when None; mm and none for a bare array.
    title : str
    looks : Looks
        Surfaces in place of the light, other colours.

    Raises
    ------
    ValueError
        If the suffix is another, or the volume has no grid or no finite value.
    """
    suffix, own = suffix_of(path, TURNING), volume_of(volume, grid)
    value_unit = own.value_unit if value_unit is None else value_unit
    own = Volume(own, own.grid, length_unit or own.length_unit, value_unit)
    title = title or Path(path).stem
    if suffix == ".png":
        from tomo.draw.volume.volume_picture import draw_volume

        save_figure(draw_volume(own, title=title, looks=looks), path)
    elif suffix == TURNING:
        with atomic_path(path) as temporary:
            temporary.write_bytes(turning_gif(own, colours=looks.colours))
    elif suffix == ".glb":
        from tomo.draw.rig.rig_scene import volume_scene
        from tomo.draw.volume.isosurface import isosurface_scene
        from tomo.draw.write_glb import write_glb

        box = volume_scene(own.grid, own.length_unit)
        write_glb(path, box + isosurface_scene(own, looks.levels or LEVELS))
    else:
        from tomo.draw.stage import Shown
        from tomo.draw.write_html import write_html

        scene = Scene(length_unit=own.length_unit)
        write_html(path, scene, title=title, shown=Shown((own,), looks=looks))
