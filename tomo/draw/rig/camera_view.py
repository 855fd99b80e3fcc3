"""One camera of a page: its picture, the objects in the picture, and the rays of its pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo.draw.page import embedded
from tomo.draw.rig.direction_table import DirectionTable
from tomo.draw.rig.rig_scene import Target, colour_of, up_of
from tomo.draw.scene import Colour
from tomo.draw.shapes import BOX_EDGES, box_corners
from tomo.grid import VoxelGrid

_ALONG = 9  # points of a projected edge: a lens bends it


@dataclass(frozen=True, eq=False)
class CameraView:
    """One camera of a page.

    Attributes
    ----------
    name : str
    colour : (3,) tuple
    table : DirectionTable
    image : (rows, columns) uint8, optional
        What it saw, shrunk.
    outlines : tuple of (N, 2) float64
        Lines to draw into the image, in pixels: the edges of the volume.
    """

    name: str
    colour: Colour
    table: DirectionTable
    image: NDArray[np.uint8] | None = None
    outlines: tuple[NDArray[np.float64], ...] = ()

    def data(self) -> dict:
        """Return plain data for the page."""
        missing = ~np.isfinite(self.table.nodes).all(axis=2)
        origins = self.table.origins
        return {
            "name": self.name,
            "colour": [round(255 * c) for c in self.colour],
            "size": list(self.table.size),
            "origin": self.table.origin.tolist(),
            "rows": self.table.nodes.shape[0],
            "columns": self.table.nodes.shape[1],
            "nodes": _flat(self.table.nodes),
            "origins": None if origins is None else _flat(origins),
            "missing": np.flatnonzero(missing).tolist(),
            "corners": [_flat(points) for points in self.table.corners],
            "straight": [
                np.flatnonzero(~np.isfinite(points).all(axis=2)).tolist()
                for points in self.table.corners
            ],
            "image": self._picture(),
            "outlines": [np.round(line, 2).tolist() for line in self.outlines],
        }

    def _picture(self) -> str | None:
        if self.image is None:
            return None
        import cv2

        return embedded(cv2.imencode(".png", self.image)[1].tobytes())


def _flat(nodes: NDArray[np.float64]) -> list[float]:
    """Return numbers for JSON, which has no NaN: missing ones are listed separately."""
    return [float(f"{value:.9g}") for value in np.nan_to_num(nodes).ravel()]


def camera_views(
    rig: Rig, grid: VoxelGrid | None = None, images: Mapping[str, NDArray] | None = None
) -> tuple[CameraView, ...]:
    """Return the views of all cameras.

    Parameters
    ----------
    rig : Rig
    grid : VoxelGrid, optional
        Whose edges are drawn into the images.
    images : mapping, optional
        Camera to thumbnail, ``(rows, columns)`` uint8.
    """
    target, up = Target.of(rig, grid), up_of(rig)
    return tuple(
        CameraView(
            camera.name,
            colour_of(camera, target, up)[1],
            DirectionTable.of(camera),
            (images or {}).get(camera.name),
            () if grid is None else tuple(box_edges(camera, grid)),
        )
        for camera in rig
    )


def box_edges(camera: CameraLike, grid: VoxelGrid) -> Iterator[NDArray[np.float64]]:
    """Yield the pixels ``(points, 2)`` of the edges of a grid's box that the lens maps."""
    corners = box_corners(grid.lower, grid.upper)
    fraction = np.linspace(0, 1, _ALONG)[:, None]
    for one, other in BOX_EDGES:
        uv, _, valid = camera.project(corners[one] + fraction * (corners[other] - corners[one]))
        if valid.all():
            yield uv
