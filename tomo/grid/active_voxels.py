"""The voxels that are unknowns: all of a grid, or those that can be other than zero.

They are stored brick by brick, so that neighbours are near in memory. In a flat volume two
neighbours along x are a whole layer apart. A ray along x then loads a cache line for every voxel
and uses one number of it. In bricks of 8³ voxels, and inside them in Morton order, neighbours
along every axis are near, and neighbouring rays find in the cache the voxels that the first of
them loaded.

G. M. Morton, "A computer oriented geodetic data base", IBM 1966.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import index_type
from tomo._compute.jit import compiled
from tomo.grid.voxel_grid import VoxelGrid

if TYPE_CHECKING:
    from tomo.grid.dense import DenseBox
    from tomo.grid.z_runs import ZRuns

BRICK_BITS = 3
"""Bits of a voxel's coordinate inside a brick: 8³ float32 are 2 kB, a part of a cache."""

_EDGE = 1 << BRICK_BITS


def brick_order(mask: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Return the storage index of each voxel chosen by ``mask`` (nx, ny, nz): (n,) int32 or int64.

    A permutation of 0 to n - 1; entry ``i`` belongs to the i-th chosen voxel in C order.
    """
    mask = np.ascontiguousarray(mask)
    index = np.zeros(mask.shape, index_type(mask.size))
    _count(mask, _MORTON, index)
    return index[mask]


def _morton_order() -> NDArray[np.int64]:
    """Return the coordinates inside a brick in Morton order, ``(8³, 3)``."""
    number, coordinates = np.arange(_EDGE**3), np.zeros((_EDGE**3, 3), np.int64)
    for bit in range(BRICK_BITS):
        for axis in range(3):
            coordinates[:, axis] |= (number >> 3 * bit + 2 - axis & 1) << bit
    return coordinates


_MORTON = _morton_order()


@compiled()
def _count(mask, order, index):
    """Write the chosen voxels' numbers, brick by brick, inside each in ``order`` (8³, 3)."""
    nx, ny, nz = mask.shape
    count = 0
    for x in range(0, nx, _EDGE):
        for y in range(0, ny, _EDGE):
            for z in range(0, nz, _EDGE):
                for n in range(len(order)):
                    i, j, k = x + order[n, 0], y + order[n, 1], z + order[n, 2]
                    if i < nx and j < ny and k < nz and mask[i, j, k]:
                        index[i, j, k] = count
                        count += 1


FEW_VOXELS = 4096
"""Unknowns up to which their order stays: in float32 half of a 32 kB cache holds them all."""

FARTHEST = int(np.iinfo(np.uint8).max)
"""Largest distance kept, in voxels: it fits a byte, and longer skips gain nothing."""


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
        """Name the sizes."""
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
        number = np.full(self.grid.size, -1, index_type(self.grid.size))
        number[slice(None) if self.index is None else self.index] = np.arange(self.size)
        return number

    @cached_property
    def distance(self) -> NDArray[np.uint8]:
        """Distance in voxels to the nearest active one, at most `FARTHEST`: the grid's shape.

        The largest difference along an axis: a ray moves by at most ``n`` along any in ``n``
        slabs.
        """
        from scipy.ndimage import distance_transform_cdt  # takes a while to import

        distance = distance_transform_cdt(~self.mask, "chessboard")  # -1 where none is active
        distance[distance < 0] = FARTHEST
        return np.minimum(distance, FARTHEST).astype(np.uint8)

    @cached_property
    def z_runs(self) -> ZRuns:
        """The runs of voxels along z that hold active ones."""
        from tomo.grid.z_runs import ZRuns  # compiled code

        return ZRuns(self.mask)

    @cached_property
    def storage_index(self) -> NDArray[np.integer] | None:
        """Index of each unknown in the order of bricks, `tomo.grid.active_voxels`: ``(size,)``.

        None for at most `FEW_VOXELS` unknowns, which a cache holds in any order.
        """
        from tomo.grid.active_voxels import brick_order  # compiled code

        return brick_order(self.mask) if self.size > FEW_VOXELS else None

    @cached_property
    def storage_index_of_voxel(self) -> NDArray[np.integer]:
        """The `storage_index` of every voxel, -1 where inactive: ``(grid.size,)``.

        The `number` where there is no storage index.
        """
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
        """Return the unknowns' values ``(unknowns, ...)`` in the order of storage."""
        return values if self.unknown_at is None else values.take(self.unknown_at, axis=0)

    def from_storage(self, values: NDArray) -> NDArray:
        """Return values in the unknowns' order; the inverse of `to_storage`."""
        return values if self.storage_index is None else values.take(self.storage_index, axis=0)

    @cached_property
    def box(self) -> ActiveVoxels:
        """The unknowns in the smallest box that holds them and a layer around, inside the grid.

        A grid of the same spacing, of one voxel where there is no unknown; its centre is not
        theirs.
        """
        if self.index is None:
            return self
        shape, inside = (1, 1, 1), np.zeros((3, 0), np.int64)
        if self.size:
            indices = np.stack(np.unravel_index(self.index, self.grid.shape))  # (3, n)
            first = np.maximum(indices.min(axis=1) - 1, 0)
            last = np.minimum(indices.max(axis=1) + 1, np.asarray(self.grid.shape) - 1)
            (nx, ny, nz), inside = (last - first + 1).tolist(), indices - first[:, None]
            shape = nx, ny, nz
        index = np.ravel_multi_index(tuple(inside), shape)
        return ActiveVoxels(VoxelGrid(shape, self.grid.spacing), np.asarray(index, np.int64))

    @cached_property
    def dense(self) -> DenseBox:
        """The `box` in arrays of any library."""
        from tomo.grid.dense import DenseBox  # for devices alone

        return DenseBox(self.box)

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
