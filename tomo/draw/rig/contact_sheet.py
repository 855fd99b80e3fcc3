"""One picture of all cameras' images, with the box of voxels as each camera sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo.draw.figures import INK, new_figure, plain, png_bytes
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def contact_sheet(
    rig: Rig, images: Mapping[str, NDArray[np.uint8]], grid: VoxelGrid, title: str = ""
) -> bytes:
    """Return a PNG of the images, the box's edges drawn into each.

    Parameters
    ----------
    rig : Rig
    images : mapping of str to (rows, columns) uint8
        By camera, see `tomo.draw.rig.thumbnails.load_thumbnails`.
    grid : VoxelGrid
    title : str
    """
    cameras = [camera for camera in rig if camera.name in images]
    tall = max(camera.image_size[1] / camera.image_size[0] for camera in cameras)
    columns = min(len(cameras), max(1, round(math.sqrt(1.5 * tall * len(cameras)))))
    rows = -(-len(cameras) // columns)
    columns = -(-len(cameras) // rows)
    figure = new_figure(10.0, rows * (10.0 / columns * tall + 0.25) + 0.5, dpi=110)
    figure.suptitle(plain(title), fontsize=10, color=INK)
    for number, camera in enumerate(cameras, 1):
        axes = figure.add_subplot(rows, columns, number)
        image = images[camera.name]
        w, h = camera.image_size
        extent = (-0.5, w - 0.5, h - 0.5, -0.5)
        axes.imshow(
            image, cmap="inferno", vmin=0, vmax=255, extent=extent, interpolation="nearest"
        )
        _draw_box(axes, camera, grid)
        axes.set_xlim(extent[:2])
        axes.set_ylim(extent[2:])
        axes.set_axis_off()
        axes.set_title(plain(camera.name), fontsize=8, color=INK, pad=3)
    figure.tight_layout(pad=0.4, rect=(0, 0, 1, 1 - 0.15 / figure.get_figheight()))
    return png_bytes(figure)


def _draw_box(axes: Axes, camera: CameraLike, grid: VoxelGrid) -> None:
    """Draw the edges of a grid's box where a camera sees them."""
    ends = np.array([grid.lower, grid.upper])
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    along = np.linspace(0.0, 1.0, 33)[:, None]
    for one, other in combinations(corners, 2):
        if np.abs(one - other).sum() != 1:
            continue
        start, end = (ends[corner, range(3)] for corner in (one, other))
        uv, _, valid = camera.project(start + along * (end - start))
        uv[~valid] = np.nan
        axes.plot(*uv.T, color="#7fd4ff", linewidth=0.8)
