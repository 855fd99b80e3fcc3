"""The light of several volumes beside each other, on a figure of the caller's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from tomo.draw.emission import COLOURS, EYE, emission_image, end_of_scale, of_integral
from tomo.draw.figures import LIGHT_INK
from tomo.draw.frame import Up, Viewpoint
from tomo.draw.shapes import box_corners
from tomo.draw.volume.visualize import volume_of
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tomo.draw.volume.visualize import GivenVolume

_PIXELS = 400
"""Longer edge of each picture: a panel of three inches at the resolution of print."""


def light_row(
    axes: Sequence[Axes],
    volumes: Mapping[str, GivenVolume],
    grid: VoxelGrid | None = None,
    *,
    eye: tuple[float, float] = EYE,
    length_unit: str = "mm",
) -> None:
    """Draw each volume's light on one of the axes: line integrals, all in the same colours.

    Parameters
    ----------
    axes : sequence of matplotlib Axes
        One for each volume; the colour bar takes its room from all of them.
    volumes : mapping of str to Reconstruction, Volume, DataArray, (nx, ny, nz) array or path
        By their titles, in the order of the axes.
    grid : VoxelGrid, optional
        That of bare arrays.
    eye : (float, float)
        Azimuth and elevation in degrees from which the volumes are seen.
    length_unit : str
        That of bare arrays.

    Raises
    ------
    ValueError
        If there are not as many axes as volumes, or a volume has no grid or another shape.
    """
    if len(axes) != len(volumes):
        raise ValueError(
            f"axes: found {len(axes)}, expected one for each of {len(volumes)} volumes"
        )
    bare = {name: type(volume) is np.ndarray for name, volume in volumes.items()}
    given = [
        volume_of(one, grid if bare[name] else None, length_unit) for name, one in volumes.items()
    ]
    views = [_view(one.grid, eye) for one in given]
    images = [emission_image(one, view) for one, view in zip(given, views, strict=True)]
    full = end_of_scale(max(float(image.max()) for image in images))
    for panel, title, view, one, image in zip(axes, volumes, views, given, images, strict=True):
        drawn = panel.imshow(image, COLOURS, vmin=0, vmax=full)
        panel.set_title(title)
        panel.set(xticks=[], yticks=[], facecolor="black")
        _scale_bar(panel, view.pixel_at(one.grid.center), image.shape, one.length_unit)
    light = of_integral(given[-1].value_unit, given[-1].length_unit)
    axes[0].figure.colorbar(drawn, ax=list(axes), label=f"light ({light})", shrink=0.8)


def _view(grid: VoxelGrid, eye: tuple[float, float]) -> Viewpoint:
    """Return the viewpoint from which the box fills a picture that is as wide as it needs."""
    up, corners = Up(), box_corners(grid.lower, grid.upper)
    how = (corners, up.eye_direction(*eye), up.vector)
    square = Viewpoint.framing(*how, (_PIXELS, _PIXELS), (0.03,) * 4, distance=6)
    width, height = np.ptp(square.project(corners), axis=0) / 0.94
    size = round(max(width, 0.4 * height)), round(max(height, 0.4 * width))
    return Viewpoint.framing(*how, size, (0.03,) * 4, distance=6)


def _scale_bar(panel: Axes, pixel: float, shape: tuple[int, int], unit: str) -> None:
    """Draw a line of 1, 2 or 5 by a power of ten, below a third of the width, and its length."""
    height, width = shape
    power = 10.0 ** np.floor(np.log10(0.3 * width * pixel))
    length = power * max(step for step in (1, 2, 5) if step * power <= 0.3 * width * pixel)
    start, level = 0.05 * width, 0.96 * height
    panel.plot([start, start + length / pixel], [level, level], color=LIGHT_INK, linewidth=2)
    panel.text(start, level - 0.02 * height, f"{length:g} {unit}", color=LIGHT_INK, fontsize=8)
