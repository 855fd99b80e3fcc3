"""The voxels that are unknowns: all of a grid, or those that can be other than zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.index_types import numbering
from tomo.grid.voxel_grid import VoxelGrid

if TYPE_CHECKING:
    from tomo.grid.z_runs import ZRuns

_FEW = 4096  # voxels: half of the smallest cache of today's processors in single precision


@dataclass(frozen=True, eq=False)
class ActiveVoxels:
    """The unknowns of a reconstruction, numbered without gaps.

    Unknown ``n`` is the voxel ``index[n]``; a voxel that is not active is known to be zero and
    takes no part.

    Attributes
    ----------
    grid : VoxelGrid
    index : (n,) int64, optional
        Flat voxel numbers, ascending; None when all voxels are active.

    Raises
    ------
    ValueError
        If the numbers do not ascend or are not voxels of the grid.
    """

    grid: VoxelGrid
    index: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        if self.index is None:
            return
        index = self.index
        if index.ndim != 1 or index.dtype != np.int64 or (np.diff(index) <= 0).any():
            raise ValueError("active voxels index: expected an ascending int64 vector")
        if len(index) and not (index[0] >= 0 and index[-1] < self.grid.size):
            raise ValueError(
                f"active voxels index: found {index[0]} to {index[-1]}, expected voxels of the "
                f"grid, 0 to {self.grid.size - 1}"
            )

    @classmethod
    def from_mask(cls, grid: VoxelGrid, mask: ArrayLike) -> ActiveVoxels:
        """Return the voxels where ``mask``, of the grid's shape or flat, is true."""
        mask = np.asarray(mask, np.bool_).ravel()
        if mask.size != grid.size:
            raise ValueError(f"active mask: found {mask.size} voxels, expected {grid.size}")
        return cls(grid) if mask.all() else cls(grid, np.flatnonzero(mask))

    def __repr__(self) -> str:
        """Name the sizes: the numbers themselves are too long to print."""
        return f"<ActiveVoxels: {self.size} of {self.grid}>"

    @property
    def all(self) -> bool:
        """Whether every voxel is active."""
        return self.index is None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.grid.size if self.index is None else len(self.index)

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """True where a voxel is active, of the grid's shape."""
        mask = np.full(self.grid.size, self.index is None)
        if self.index is not None:
            mask[self.index] = True
        return mask.reshape(self.grid.shape)

    @cached_property
    def number(self) -> NDArray[np.integer]:
        """The unknown of every voxel, -1 where there is none: ``(grid.size,)``."""
        number = np.full(self.grid.size, -1, numbering(self.grid.size))
        number[slice(None) if self.index is None else self.index] = np.arange(self.size)
        return number

    @cached_property
    def clearance(self) -> NDArray[np.uint8]:
        """Distance from the nearest active voxel, up to 255 voxels: (nx, ny, nz)."""
        from tomo.grid.distance import clearance  # compiled code

        return clearance(self.mask)

    @cached_property
    def z_runs(self) -> ZRuns:
        """The runs along z that hold active voxels."""
        from tomo.grid.z_runs import ZRuns  # compiled code

        return ZRuns(self.mask)

    @cached_property
    def storage_index(self) -> NDArray[np.integer] | None:
        """Index of each unknown in memory, sorted by bricks, ``(size,)``.

        None where a cache holds all unknowns in any order.
        """
        from tomo.grid.bricks import brick_storage_index  # compiled code

        return brick_storage_index(self.mask) if self.size > _FEW else None

    @cached_property
    def storage_index_of_voxel(self) -> NDArray[np.integer]:
        """The `storage_index` of every voxel, or its number; -1 if inactive: (grid.size,)."""
        if self.storage_index is None:
            return self.number
        index = np.full_like(self.number, -1)
        index[slice(None) if self.index is None else self.index] = self.storage_index
        return index

    @cached_property
    def unknown_at(self) -> NDArray[np.integer] | None:
        """The unknown at each `storage_index`, ``(size,)``; None where there is none."""
        if self.storage_index is None:
            return None
        unknown = np.zeros_like(self.storage_index)
        unknown[self.storage_index] = np.arange(self.size, dtype=unknown.dtype)
        return unknown

    def to_storage(self, values: NDArray) -> NDArray:
        """Return values of the unknowns in storage order."""
        return values if self.unknown_at is None else values.take(self.unknown_at)

    def from_storage(self, values: NDArray) -> NDArray:
        """Return values in storage order in the order of the unknowns: undoes `to_storage`."""
        return values if self.storage_index is None else values.take(self.storage_index)

    @cached_property
    def box(self) -> ActiveVoxels:
        """The unknowns in the smallest box that holds them and a layer around, inside the grid.

        The box is a grid of the same spacing, of one voxel if there is no unknown; its position is
        not that of the unknowns.
        """
        if self.all:
            return self
        shape, inside = (1, 1, 1), np.zeros((3, 0), np.int64)
        if self.size:
            position = np.stack(np.unravel_index(self.index, self.grid.shape))  # (3, n)
            first = np.maximum(position.min(axis=1) - 1, 0)
            last = np.minimum(position.max(axis=1) + 1, np.asarray(self.grid.shape) - 1)
            shape, inside = tuple((last - first + 1).tolist()), position - first[:, None]
        return ActiveVoxels(
            VoxelGrid(shape, self.grid.spacing), np.ravel_multi_index(tuple(inside), shape)
        )

    def expand(self, values: NDArray, fill: float = 0.0) -> NDArray:
        """Return the flat volume of the unknowns ``values``, ``fill`` elsewhere: (grid.size,).

        Nothing is copied when all voxels are active.
        """
        if self.index is None:
            return values
        volume = np.full(self.grid.size, fill, values.dtype)
        volume[self.index] = values
        return volume

    def compress(self, volume: NDArray) -> NDArray:
        """Return the unknowns of a volume, flat or of the grid's shape: ``(size,)``.

        Nothing is copied when all voxels are active.
        """
        volume = volume.reshape(-1)
        return volume if self.index is None else volume[self.index]
