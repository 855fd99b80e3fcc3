"""A volume in a file to look at: PNG for papers, HTML to turn around, GLB for viewers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import write_bytes
from tomo.draw.emission import EYE, LIGHT, Looks, turning_gif
from tomo.draw.figures import (
    FIGURE_SUFFIXES,
    INK,
    MUTED,
    PRINT_DPI,
    TURNING,
    new_figure,
    raised,
    save_figure,
    suffix_of,
    with_unit,
)
from tomo.draw.frame import UP, Viewpoint
from tomo.draw.rig.rig_scene import volume_scene
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.shapes import box_corners
from tomo.draw.stage import Shown
from tomo.draw.still import panel, show_light
from tomo.draw.volume.isosurface import LEVELS, finite, isosurface_scene
from tomo.draw.volume.planes import Slices, planes_row, row_size
from tomo.draw.writers import write_glb, write_html
from tomo.grid import Volume, VoxelGrid
from tomo.io import read_volume, volume_of_data_array
from tomo.pipeline import Reconstruction

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import DataArray

    GivenVolume: TypeAlias = Reconstruction | DataArray | NDArray | str | os.PathLike

_HEIGHT = 4.9  # inches of the picture


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
        A .png, .pdf, .svg, .html, .glb or .gif file to write; the last turns once around.
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
    if suffix in FIGURE_SUFFIXES:
        save_figure(draw_volume(own, title=title, looks=looks), path)
    elif suffix == TURNING:
        write_bytes(path, turning_gif(own, colours=looks.colours))
    elif suffix == ".glb":
        box = volume_scene(own.grid, own.length_unit)
        write_glb(path, box + isosurface_scene(own, looks.levels or LEVELS))
    else:
        scene = Scene(length_unit=own.length_unit)
        write_html(path, scene, title=title, shown=Shown((own,), looks=looks))


def draw_volume(volume: Volume, *, title: str = "", looks: Looks = LIGHT) -> Figure:
    """Return the figure: the volume's light as a camera sees it, and three middle planes.

    Raises
    ------
    ValueError
        If no value is finite.
    """
    if not np.isfinite(volume).any():
        raise ValueError("volume: found no finite value, expected at least one to draw")
    volume, grid, unit = finite(volume), volume.grid, volume.length_unit
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    inches = min(4.2 / wide.sum(), (_HEIGHT - 1.8) / tall.max())
    across = float(np.hypot(*grid.extent[[0, 2]]) / grid.extent[1])
    sight = min(max(3.2 * across + 1.9, 2.6), 5.0)  # inches of the light's width
    size = sight + 0.2 + row_size(grid, inches)[0], _HEIGHT
    figure = new_figure(*size, dpi=PRINT_DPI)
    place: dict[str, Any] = {"x": 0.12 / size[0], "va": "center", "parse_math": False}
    figure.text(
        **place, y=1 - 0.24 / _HEIGHT, s=title or "Volume", fontsize=11, weight="bold", color=INK
    )
    lowest, highest = min(float(volume.min()), 0.0), max(float(volume.max()), 0.0)
    sizes = " × ".join(f"{length:.4g}" for length in grid.extent)
    counts = " × ".join(str(n) for n in grid.shape)
    ends = f"{volume.min():.3g} to {volume.max():.3g} {raised(volume.value_unit)}".strip()
    words = f"{sizes} {unit}, {counts} voxels, values {ends}"
    figure.text(**place, y=1 - 0.47 / _HEIGHT, s=words, fontsize=8, color=MUTED)
    rect = (0.12 / size[0], 0.12 / _HEIGHT, sight / size[0], 1 - 0.8 / _HEIGHT)
    axes, pixels = panel(figure, rect)
    bounds = np.stack([grid.lower, grid.upper])
    viewpoint = Viewpoint.framing(
        box_corners(*bounds), UP.eye_direction(*EYE), UP.vector, pixels,
        margins=(0.24, 0.08, 0.03, 0.12), distance=6,
    )  # fmt: skip
    scene = volume_scene(grid, unit) if looks.levels else Scene(length_unit=unit)
    show_light(axes, volume, scene, viewpoint, bounds, up=UP, looks=looks)
    scale = ColourScale(
        with_unit("emission", volume.value_unit),
        lowest,
        highest if highest > lowest else 1.0,
        looks.colours,
    )
    corner = sight + 0.2, _HEIGHT - 0.55
    planes_row(figure, corner, inches, Slices("Middle planes", volume, scale))
    return figure


def volume_of(
    given: GivenVolume, grid: VoxelGrid | None = None, length_unit: str = "mm"
) -> Volume:
    """Return what was given with its grid and units.

    Parameters
    ----------
    given : Volume, Reconstruction, DataArray, (nx, ny, nz) array or path-like
    grid : VoxelGrid, optional
        Of a bare array, which has none; nothing else may come with one.
    length_unit : str
        Of a bare array.

    Raises
    ------
    ValueError
        If an array has no grid or another shape, something else has two, or a file is no volume.
    """
    if isinstance(given, Volume):
        own = given
    elif isinstance(given, Reconstruction):
        own = given.volume
    elif isinstance(given, str | os.PathLike):
        own, *_ = read_volume(given, allow_nan=True)
    elif hasattr(given, "dims"):
        own = volume_of_data_array(given)
    else:
        data = np.asarray(given)
        if grid is None or data.shape != grid.shape:
            expected = "a grid with it" if grid is None else f"the grid's {grid.shape}"
            raise ValueError(f"volume: found an array of shape {data.shape}, expected {expected}")
        return Volume(data, grid, length_unit)
    if grid is not None and grid != own.grid:
        raise ValueError(f"volume: found it on {own.grid}, expected no other grid with it")
    return own
