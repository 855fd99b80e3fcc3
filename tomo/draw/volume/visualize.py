"""A volume in a file to look at: PNG for papers, HTML to turn around, GLB for viewers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from tomo.draw.volume.given import volume_of
from tomo.grid import VoxelGrid

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
) -> None:
    """Draw a volume's planes, line integrals and surfaces, as ``flametomo visualize-volume``.

    Parameters
    ----------
    path : path-like
        A .png, .html or .glb file to write.
    volume : Reconstruction, DataArray, (nx, ny, nz) array or path-like
    grid : VoxelGrid, optional
        Of a bare array.
    length_unit, value_unit : str, optional
        The volume's own when None; mm and none for a bare array.
    title : str

    Raises
    ------
    ValueError
        If the suffix is another, or the volume has no grid or no finite value.
    """
    from tomo.draw.suffixes import suffix_of

    suffix, own = suffix_of(path), volume_of(volume, grid)
    unit = length_unit or own.length_unit or "mm"
    value_unit = own.value_unit if value_unit is None else value_unit
    title = title or Path(path).stem
    if suffix == ".png":
        from tomo.draw.volume.volume_picture import write_volume_picture

        write_volume_picture(
            path, own.data, own.grid, length_unit=unit, value_unit=value_unit, title=title
        )
        return
    from tomo.draw.rig.rig_scene import volume_scene
    from tomo.draw.volume.isosurface import isosurface_scene

    scene = volume_scene(own.grid, unit) + isosurface_scene(own.data, own.grid, unit)
    if suffix == ".glb":
        from tomo.draw.write_glb import write_glb

        write_glb(path, scene)
        return
    from tomo.draw.write_html import write_html

    write_html(path, scene, title=title, volume=own.data, grid=own.grid, value_unit=value_unit)
