"""One picture of all cameras' images, with the box of voxels as each camera sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.draw.figures import INK, new_figure, plain, png_bytes
from tomo.draw.rig.camera_view import box_edges
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
    figure = new_figure(10.0, rows * (10.0 / columns * tall + 0.2) + 0.35, dpi=110)
    figure.set_layout_engine("compressed", w_pad=0.01, h_pad=0.01, wspace=0, hspace=0)
    figure.suptitle(plain(title), fontsize=10, color=INK)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, camera in zip(panels, cameras, strict=False):
        width, height = camera.image_size
        extent = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(images[camera.name], cmap="inferno", vmin=0, vmax=255, extent=extent)
        for edge in box_edges(camera, grid):
            axes.plot(*edge.T, color="#7fd4ff", linewidth=0.8)
        axes.set(xlim=extent[:2], ylim=extent[2:])
        axes.set_title(plain(camera.name), fontsize=8, color=INK, pad=2)
    return png_bytes(figure)
