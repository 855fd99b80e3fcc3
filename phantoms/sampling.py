"""Voxel means of a field, and a volume as a field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phantoms.field import Field, as_points

_POINTS_AT_ONCE = 2**18  # 6 MiB of coordinates


class Grid(Protocol):
    """Members of a voxel grid that `sample` and `SampledField` use, as of `tomo.VoxelGrid`."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along x, y and z."""

    def axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the voxel centres along x, y and z."""

    def refined(self, factor: int) -> Grid:
        """Return the grid with every voxel cut into ``factor``³ equal ones."""

    def voxel_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the flat index of the voxel that each point is in, -1 outside."""


def sample(field: Field, grid: Grid, refine: int = 1) -> NDArray[np.float32]:
    """Return the means of a field over the voxels of a grid.

    Each voxel is split into ``refine``³ equal boxes, and the field is averaged over their middles
    (midpoint rule). For a field with bounded second derivatives the error of a voxel's mean falls
    with the second power of ``spacing / refine``; for one with jumps, as
    :class:`RandomHomogeneous` on a grid that cuts its cells or a :class:`SampledField`, with the
    first power.

    Parameters
    ----------
    field : callable
        Maps points ``(N, 3)`` to values ``(N,)``.
    grid : Grid
        A `tomo.VoxelGrid`, or anything with its methods.
    refine : int
        Points along each edge of a voxel.

    Returns
    -------
    (nx, ny, nz) float32
        Summed in float64. Temporary memory is tens of MiB for any grid.

    Raises
    ------
    ValueError
        If ``refine`` is not a whole number >= 1, or the field returns another shape or a value
        that is not finite.
    """
    x, y, z = grid.refined(refine).axes()  # raises if refine is not a whole number >= 1
    refine = int(refine)
    nx, ny, nz = grid.shape
    volume = np.zeros(grid.shape, np.float32)
    columns = max(1, _POINTS_AT_ONCE // (nz * refine**3))  # voxel columns along z at once
    if columns >= ny:
        blocks = [(i, min(i + columns // ny, nx), 0, ny) for i in range(0, nx, columns // ny)]
    else:
        blocks = [
            (i, i + 1, j, min(j + columns, ny)) for i in range(nx) for j in range(0, ny, columns)
        ]
    for i, i_end, j, j_end in blocks:
        axes = (x[i * refine : i_end * refine], y[j * refine : j_end * refine], z)
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = field(points.reshape(-1, 3))
        if np.shape(values) != (points.size // 3,):
            raise ValueError(
                f"field: found values of shape {np.shape(values)} at {points.size // 3} points, "
                f"expected ({points.size // 3},)"
            )
        if not np.isfinite(values).all():
            raise ValueError("field: found NaN or infinity, expected finite values")
        parts = np.reshape(values, (i_end - i, refine, j_end - j, refine, nz, refine))
        volume[i:i_end, j:j_end] = parts.mean(axis=(1, 3, 5), dtype=np.float64)
    return volume


@dataclass(frozen=True, eq=False)
class SampledField:
    """A stored volume as a field: the value of the voxel that a point is in, zero outside.

    Values are returned as stored, negative ones included.

    Parameters
    ----------
    volume : (nx, ny, nz)
        Any real dtype; kept as a read-only view.
    grid : Grid
        The volume's grid: a `tomo.VoxelGrid`, or anything with its methods.

    Raises
    ------
    ValueError
        If the shapes differ, or a value is not a finite real number.
    """

    volume: NDArray
    grid: Grid

    def __post_init__(self) -> None:
        """Check that the volume belongs to the grid."""
        volume = np.asarray(self.volume).view()
        if volume.shape != self.grid.shape:
            raise ValueError(
                f"volume: found shape {volume.shape}, expected the grid's {self.grid.shape}"
            )
        if volume.dtype.kind not in "buif":
            raise ValueError(f"volume: found {volume.dtype}, expected real numbers")
        if not np.isfinite(volume).all():
            raise ValueError("volume: found NaN or infinity, expected finite values")
        volume.flags.writeable = False
        object.__setattr__(self, "volume", volume)

    def __repr__(self) -> str:
        """Name the grid; the volume is too long to print."""
        return f"<SampledField: {self.volume.dtype} on {self.grid}>"

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the values ``(...)``, float64, at ``points`` ``(..., 3)``."""
        index = self.grid.voxel_of(as_points(points))
        values = np.ravel(self.volume)[np.maximum(index, 0)]
        return np.where(index >= 0, values, 0).astype(np.float64)
