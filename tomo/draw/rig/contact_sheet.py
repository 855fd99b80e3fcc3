"""One picture of all cameras' images, with the box of voxels as each camera sees it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo.draw.figures import INK, new_figure, plain, png_bytes
from tomo.grid import VoxelGrid


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
    high = tall + 0.026 * columns  # of a cell, its width being 1: the picture and the name above
    figure = new_figure(10.0, 10.0 / columns * rows * high + 0.35, dpi=110)
    figure.suptitle(plain(title), fontsize=10, color=INK, y=1 - 0.12 / figure.get_figheight())
    axes = figure.add_axes((0, 0, 1, 1 - 0.35 / figure.get_figheight()))
    for number, camera in enumerate(cameras):
        row, column = divmod(number, columns)
        width, height = camera.image_size
        pixel = 0.98 * min(1 / width, tall / height)
        left, top = column + 0.5 - pixel * width / 2, (row + 1) * high - pixel * height
        extent = (left, left + pixel * width, top + pixel * height, top)
        axes.imshow(images[camera.name], cmap="inferno", vmin=0, vmax=255, extent=extent)
        for edge in _edges(camera, grid):
            axes.plot(*((edge + 0.5) * pixel + (left, top)).T, color="#7fd4ff", linewidth=0.8)
        axes.text(column + 0.5, top, plain(camera.name), fontsize=8, color=INK, ha="center",
                  va="bottom")  # fmt: skip
    axes.set_xlim(0, columns)
    axes.set_ylim(rows * high, 0)
    axes.set_axis_off()
    return png_bytes(figure)


def _edges(camera: CameraLike, grid: VoxelGrid) -> Iterator[NDArray[np.float64]]:
    """Yield the pixels (points, 2) of each edge of a grid's box; NaN where they are not seen."""
    ends = np.array([grid.lower, grid.upper])
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    along = np.linspace(0.0, 1.0, 200)[:, None]
    for one, other in combinations(corners, 2):
        if np.abs(one - other).sum() == 1:
            start, end = (ends[corner, range(3)] for corner in (one, other))
            uv, _, valid = camera.project(start + along * (end - start))
            uv[~valid | ~camera.inside(uv)] = np.nan
            yield uv
