"""The light of a volume that arrives at a view's pixels in all, whatever rays sample them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.operator import ProjectionOperator

MOST_CELLS = 200_000
"""Cells that a volume's light is summed over. More take longer; of fewer, the border of the pixels
that take part cuts through large ones."""


@dataclass(frozen=True, eq=False)
class ViewLight:
    """How much a view's pixels record in all of the light that each part of a volume emits.

    Attributes
    ----------
    weight : (views, cells) float32
        Sum of a view's pixels for a sum of one over a cell's unknowns.
    edge : int
        Voxels along each edge of a cell.
    clear : ProjectionOperator, optional
        The same rays through transparent gas, where gas absorbs.

    Notes
    -----
    Pixels are means of line integrals over their area, so a voxel of the volume ``V`` and the
    emission ``e`` adds ``e V d`` to their sum, whatever its shape, where ``d`` is the number of
    pixels that see a unit area across the line of sight. With the Jacobian ``J = du/dx``,
    ``(2, 3)``, of the projection ``d = sqrt(det(J J'))``. Rays, one through each pixel, only
    sample this: pixels that are not far smaller than voxels meet some voxels more than others.
    """

    weight: NDArray[np.float32]
    edge: int = 1
    clear: ProjectionOperator | None = None

    @classmethod
    def of(cls, system: LinearSystem, clear: LinearSystem | None = None) -> ViewLight:
        """Return the weights of a system's pixels.

        Parameters
        ----------
        system : LinearSystem
        clear : LinearSystem, optional
            The same equations for transparent gas; needed where gas absorbs.

        Notes
        -----
        Cameras that look through a scene have the sums of their rays: glass takes some light.
        """
        rays, grid = (clear or system).projector, system.projector.grid
        edge = int(np.ceil((grid.size / MOST_CELLS) ** (1 / 3)))
        cells = tuple(-(-n // edge) for n in grid.shape)
        weight = np.zeros((len(system.rig), int(np.prod(cells))), np.float32)
        for view, (camera, pixels) in enumerate(zip(system.rig, system.pixels, strict=True)):
            if camera.is_straight and camera.sees_once:
                weight[view] = _weights(camera, pixels, grid, edge).ravel()
            else:
                own = rays.active.expand(rays.view(view).column_sums).reshape(grid.shape)
                voxels = rays.active.mask.reshape(grid.shape).astype(np.float64)
                weight[view] = (_sums(own, edge) / np.maximum(_sums(voxels, edge), 1)).ravel()
        return cls(weight, edge, None if clear is None else clear.projector)

    def totals(
        self,
        projector: ProjectionOperator,
        unknowns: NDArray[np.floating],
        predicted: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the sum of every view's pixels, ``(views,)``.

        Parameters
        ----------
        projector : ProjectionOperator
            Of the pixels that the weights were made of.
        unknowns : (unknowns,)
        predicted : (pixels,)
            ``projector @ unknowns``. Where gas absorbs, it tells which fraction arrives.
        """
        volume = projector.active.expand(unknowns.astype(np.float64)).reshape(projector.grid.shape)
        light = self.weight @ _sums(volume, self.edge).ravel()
        if self.clear is not None:
            sent = view_sums(projector, np.asarray(self.clear @ unknowns, np.float64))
            arriving = view_sums(projector, predicted)
            light *= np.divide(arriving, sent, out=np.ones_like(sent), where=sent > 0)
        return light


def view_sums(projector: ProjectionOperator, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sum of each view's pixels, ``(views,)``."""
    before = np.concatenate([[0.0], np.cumsum(pixels, dtype=np.float64)])
    return np.diff(before[projector.view_ptr])


def _sums(volume: NDArray[np.float64], edge: int) -> NDArray[np.float64]:
    """Return the sums over cells of ``edge`` voxels along each axis; the last may be smaller."""
    for axis in range(3) if edge > 1 else ():
        volume = np.add.reduceat(volume, np.arange(0, volume.shape[axis], edge), axis=axis)
    return volume


def _weights(
    camera: CameraLike, pixels: NDArray[np.int64], grid: VoxelGrid, edge: int
) -> NDArray[np.float64]:
    """Return what the pixels of one camera record of every cell, ``(cx, cy, cz)``."""
    axes = [
        low + step * np.minimum(np.arange(0, n + edge, edge), n)
        for low, step, n in zip(grid.lower, grid.spacing, grid.shape, strict=True)
    ]
    corners = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    uv, _, valid = camera.project(corners.reshape(-1, 3))
    seen = np.where(valid[:, None], uv, np.nan).reshape((*corners.shape[:3], 2))
    steps = []
    for axis in range(3):
        across = np.diff(seen, axis=axis)
        for other in {0, 1, 2} - {axis}:
            across = _between(across, other)
        size = np.diff(axes[axis]).reshape([-1 if n == axis else 1 for n in range(3)])
        steps.append(across / size[..., None])
    jacobian = np.stack(steps, axis=-1)  # (cx, cy, cz, 2, 3)
    squares = jacobian @ np.swapaxes(jacobian, -1, -2)
    area = squares[..., 0, 0] * squares[..., 1, 1] - squares[..., 0, 1] ** 2
    density = np.sqrt(np.maximum(area, 0)) * float(np.prod(grid.spacing))
    middle = _between(_between(_between(seen, 0), 1), 2)
    return np.where(_taking_part(camera, pixels, middle), density, 0)


def _between(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return the means of neighbours along an axis."""
    first, last = (np.take(values, np.arange(values.shape[axis] - 1) + n, axis) for n in (0, 1))
    return (first + last) / 2


def _taking_part(
    camera: CameraLike, pixels: NDArray[np.int64], uv: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return whether the pixels at ``uv`` ``(..., 2)`` are among ``pixels``."""
    width, height = camera.image_size
    used = np.zeros(width * height, bool)
    used[pixels] = True
    column, row = np.moveaxis(np.floor(np.nan_to_num(uv, nan=-1.0) + 0.5).astype(np.int64), -1, 0)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return inside & used[np.where(inside, row * width + column, 0)]
