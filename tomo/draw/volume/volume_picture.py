"""A volume's picture for print: its light, or surfaces, and its middle planes, to scale."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.emission import EYE, LIGHT, Looks
from tomo.draw.figures import INK, MUTED, new_figure, raised, save_figure, with_unit
from tomo.draw.rig.rig_scene import volume_scene
from tomo.draw.scene import ColourScale, Scene
from tomo.draw.shapes import box_corners
from tomo.draw.still import panel, show_light
from tomo.draw.viewpoint import Viewpoint
from tomo.draw.volume.planes import planes_row, row_size
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DPI = 200
_HEIGHT = 4.9  # inches of the picture


def draw_volume(
    data: NDArray,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    value_unit: str = "",
    title: str = "",
    supersample: int = 3,
    looks: Looks = LIGHT,
) -> Figure:
    """Return the figure: the volume's light as a camera sees it, and three middle planes.

    Parameters
    ----------
    data : (nx, ny, nz)
        Values at the voxels.
    grid : VoxelGrid
    length_unit : str
        Of the grid.
    value_unit : str
        Of the values; empty if unknown.
    title : str
        Stands above the picture.
    supersample : int
        Rays along each side of a pixel, for surfaces.
    looks : Looks
        Surfaces in place of the light, other colours.

    Raises
    ------
    ValueError
        If the volume's shape is not the grid's, or no value is finite.
    """
    if data.shape != grid.shape:
        raise ValueError(f"volume: found shape {data.shape}, expected the grid's {grid.shape}")
    if not np.isfinite(data).any():
        raise ValueError("volume: found no finite value, expected at least one to draw")
    data = np.nan_to_num(np.asarray(data, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    wide, tall = grid.extent[[0, 2, 0]], grid.extent[[1, 1, 2]]
    inches = min(4.2 / wide.sum(), (_HEIGHT - 1.95) / tall.max())
    across = float(np.hypot(*grid.extent[[0, 2]]) / grid.extent[1])
    sight = min(max(3.2 * across + 1.9, 2.6), 5.0)  # inches of the light's width
    size = sight + 0.2 + row_size(grid, inches)[0], _HEIGHT
    figure = new_figure(*size, dpi=_DPI)
    place: dict[str, Any] = {"x": 0.12 / size[0], "va": "center", "parse_math": False}
    figure.text(
        **place, y=1 - 0.24 / _HEIGHT, s=title or "Volume", fontsize=11, weight="bold", color=INK
    )
    sizes = " × ".join(f"{length:.4g}" for length in grid.extent)
    counts = " × ".join(str(n) for n in grid.shape)
    values = f"values {data.min():.3g} to {data.max():.3g} {raised(value_unit)}".strip()
    words = f"{sizes} {length_unit}, {counts} voxels, {values}"
    figure.text(**place, y=1 - 0.47 / _HEIGHT, s=words, fontsize=8, color=MUTED)
    rect = (0.12 / size[0], 0.12 / _HEIGHT, sight / size[0], 1 - 0.8 / _HEIGHT)
    axes, pixels = panel(figure, rect)
    up, bounds = frame.Up(), np.stack([grid.lower, grid.upper])
    viewpoint = Viewpoint.framing(
        box_corners(*bounds), up.eye_direction(*EYE), up.vector, pixels,
        margins=(0.24, 0.08, 0.03, 0.12), distance=6,
    )  # fmt: skip
    scene = volume_scene(grid, length_unit) if looks.levels else Scene(length_unit=length_unit)
    show_light(
        axes, data, grid, scene, viewpoint, bounds, up=up, supersample=supersample,
        value_unit=value_unit, looks=looks,
    )  # fmt: skip
    lowest, highest = min(float(data.min()), 0.0), max(float(data.max()), 0.0)
    scale = ColourScale(
        with_unit("emission", value_unit),
        lowest,
        highest if highest > lowest else 1.0,
        looks.colours,
    )
    corner = sight + 0.2, _HEIGHT - 0.55
    planes_row(
        figure, corner, inches, data, grid, scale, heading="Middle planes", length_unit=length_unit
    )
    return figure


def write_volume_picture(
    path: str | os.PathLike,
    data: NDArray,
    grid: VoxelGrid,
    *,
    length_unit: str = "mm",
    value_unit: str = "",
    title: str = "",
    looks: Looks = LIGHT,
    supersample: int = 3,
) -> None:
    """Write `draw_volume`'s figure as a PNG file."""
    units = {"length_unit": length_unit, "value_unit": value_unit}
    figure = draw_volume(data, grid, **units, title=title, looks=looks, supersample=supersample)
    save_figure(figure, path)
