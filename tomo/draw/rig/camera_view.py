"""One camera of a page: its picture, the objects in the picture, and the rays of its pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs import CameraLike, Rig
from rigs.geometry.points import ALONG
from tomo.draw.page import embedded
from tomo.draw.rig.rig_scene import Target, colour_of, up_of
from tomo.draw.scene import Colour
from tomo.draw.shapes import BOX_EDGES, box_corners
from tomo.grid import VoxelGrid

_CELLS = (3, 6, 12, 24, 48)  # along a side


@dataclass(frozen=True, eq=False)
class CameraView:
    """One camera of a page."""

    name: str
    colour: Colour
    table: DirectionTable
    image: NDArray[np.uint8] | None = None  # (rows, columns): what it saw, shrunk
    outlines: tuple[NDArray[np.float64], ...] = ()  # edges of the volume, (N, 2) in its pixels

    def data(self) -> dict:
        """Return plain data for the page."""
        import cv2

        table, image = self.table, self.image
        return {
            "name": self.name,
            "colour": [round(255 * c) for c in self.colour],
            "size": list(table.size),
            "origin": table.origin.tolist(),
            "rows": table.nodes.shape[0],
            "columns": table.nodes.shape[1],
            "nodes": _flat(table.nodes),
            "origins": None if table.origins is None else _flat(table.origins),
            "missing": _missing(table.nodes),
            "corners": [_flat(points) for points in table.corners],
            "straight": [_missing(points) for points in table.corners],
            "image": None if image is None else embedded(cv2.imencode(".png", image)[1].tobytes()),
            "outlines": [np.round(line, 2).tolist() for line in self.outlines],
        }


def _missing(nodes: NDArray[np.float64]) -> list[int]:
    return np.flatnonzero(~np.isfinite(nodes).all(axis=2)).tolist()


def _flat(nodes: NDArray[np.float64]) -> list[float]:
    """Return numbers for JSON, which has no NaN: missing ones are listed separately."""
    return [float(f"{value:.9g}") for value in np.nan_to_num(nodes).ravel()]


def camera_views(
    rig: Rig, grid: VoxelGrid | None = None, images: Mapping[str, NDArray] | None = None
) -> tuple[CameraView, ...]:
    """Return the views of all cameras, the edges of ``grid`` drawn into their thumbnails."""
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
    fraction = np.linspace(0, 1, ALONG)[:, None]
    for one, other in BOX_EDGES:
        uv, _, valid = camera.project(corners[one] + fraction * (corners[other] - corners[one]))
        if valid.all():
            yield uv


@dataclass(frozen=True, eq=False)
class DirectionTable:
    """Directions at nodes spread evenly over an image, from its outer border to the other.

    Between nodes both follow the cubic through the four nearest nodes along each side, or
    straight lines where one of those is NaN; where a cell has a corner that is NaN there is none.
    """

    origin: NDArray[np.float64]  # (3,), where rays start: the camera's position
    size: tuple[int, int]
    # (rows, columns, 3) world directions, scaled such that a pinhole's lie on a plane; NaN where
    # the lens maps none
    nodes: NDArray[np.float64]
    # (rows, columns, 3) where rays start that do not meet in a point
    origins: NDArray[np.float64] | None = None
    # (rows, columns, 3) each: points, from the camera on, between which each node's ray comes to
    # its origin through a scene; NaN where it does so at another number of faces than most
    corners: tuple[NDArray[np.float64], ...] = ()

    @classmethod
    def of(cls, camera: CameraLike, tolerance: float = 0.05) -> DirectionTable:
        """Return the smallest table that is right to ``tolerance`` pixels between its nodes.

        A pinhole needs 4 x 4 nodes; a lens that would need more than 49 x 49 keeps that many.
        """
        for cells in _CELLS:
            table = cls(camera.position, camera.image_size, *_nodes(camera, cells))
            if table._error(camera, cells) <= tolerance:
                break
        return table

    def directions(self, uv: ArrayLike) -> NDArray[np.float64]:
        """Return unit vectors ``(N, 3)`` at the pixel coordinates ``uv`` ``(N, 2)``."""
        rows, columns, _ = self.nodes.shape
        place = (np.asarray(uv, np.float64) + 0.5) / self.size * [columns - 1, rows - 1]
        found = _between(self.nodes, place, 4)
        straight = _between(self.nodes, place, 2)
        found = np.where(np.isfinite(found), found, straight)
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def _error(self, camera: CameraLike, cells: int) -> float:
        """Return the largest error half way between nodes, in pixels of the image's middle."""
        steps = np.arange(2 * cells + 1) / (2 * cells)
        u, v = np.meshgrid(steps, steps)
        uv = np.stack([u.ravel(), v.ravel()], axis=-1) * self.size - 0.5
        true = camera.rays(uv)[1]
        if not np.isfinite(true).all() and cells < 24:  # the lens's own border has to be found
            return np.inf
        sine = np.linalg.norm(np.cross(self.directions(uv), true), axis=1)
        middle = np.array(self.size) / 2 - 0.5
        neighbours = camera.rays(np.add(middle, [[0, 0], [1, 0], [0, 1]]))[1]
        pixel = np.linalg.norm(neighbours[1:] - neighbours[0], axis=1).min()
        finite = sine[np.isfinite(sine)]
        return float(finite.max() / pixel) if finite.size else 0.0


def _between(nodes: NDArray, place: NDArray, count: int) -> NDArray[np.float64]:
    """Return the polynomial through ``count`` nodes along each side at ``place`` ``(N, 2)``."""
    rows, columns, _ = nodes.shape
    most = [columns - count, rows - count]
    first = np.clip(np.floor(place) - (count // 2 - 1), 0, most).astype(np.int64)
    across, down = np.moveaxis(_lagrange(place - first, count), 1, 0)  # (N, count) each
    steps = np.arange(count)
    patch = nodes[first[:, 1, None, None] + steps[:, None], first[:, 0, None, None] + steps]
    return np.einsum("nr,nc,nrci->ni", down, across, patch)


def _lagrange(place: NDArray, nodes: int) -> NDArray[np.float64]:
    """Return the weights ``(..., nodes)`` of nodes at 0, 1, 2 ... of the polynomial's value."""
    weights = np.ones((*place.shape, nodes))
    for one in range(nodes):
        for other in range(nodes):
            if other != one:
                weights[..., one] *= (place - other) / (one - other)
    return weights


def _nodes(camera: CameraLike, cells: int) -> tuple[NDArray, NDArray | None, tuple]:
    """Return directions, origins if many, and corners at a table's nodes."""
    steps = np.arange(cells + 1) / cells
    u, v = np.meshgrid(steps, steps)
    uv = np.stack([u.ravel(), v.ravel()], axis=-1) * camera.image_size - 0.5
    origins, directions = camera.rays(uv)
    ahead = directions @ camera.R[2]
    if not (ahead[np.isfinite(ahead)] < 0.1).any():  # a pinhole's are straight on this plane
        directions = directions / ahead[:, None]
    shape = (cells + 1, cells + 1, 3)
    is_central = (origins == origins[0]).all()
    corners = () if camera.is_straight else _corners(camera, uv, shape)
    return directions.reshape(shape), None if is_central else origins.reshape(shape), corners


def _corners(camera: CameraLike, uv: NDArray, shape: tuple[int, ...]) -> tuple[NDArray, ...]:
    """Return the points at which rays through a scene begin and turn; see `DirectionTable`."""
    paths, pixels = camera.paths(uv)
    if not len(pixels):
        return ()
    before = paths.nearest_pieces(np.array(camera.middle)) - paths.ray_ptr[:-1]
    most = int(np.bincount(before).argmax())
    alike = np.flatnonzero(before == most)
    found = []
    for turn in range(most):
        points = np.full((len(uv), 3), np.nan)
        points[pixels[alike]] = paths.origins[paths.ray_ptr[alike] + turn]
        found.append(points.reshape(shape))
    return tuple(found)
