"""Which voxels are unknowns: all of a grid, or those that can be other than zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.index_types import numbering
from tomo.grid.voxel_grid import VoxelGrid

if TYPE_CHECKING:
    from tomo.grid.z_runs import LiveLines

_FEW = 4096  # in single precision half of the smallest cache of today's processors


@dataclass(frozen=True, eq=False)
class ActiveVoxels:
    """The unknowns of a reconstruction, numbered without gaps.

    Unknown ``n`` is the voxel ``index[n]``; a voxel that is not active is known to be zero and
    takes no part in anything.

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
        """How many voxels each is from the nearest active one, at most 255: the grid's shape."""
        from tomo.grid.distance import clearance  # compiled code

        return clearance(self.mask)

    @cached_property
    def lines(self) -> LiveLines:
        """The lines along z that hold active voxels."""
        from tomo.grid.z_runs import LiveLines  # compiled code

        return LiveLines(self.mask)

    @cached_property
    def place(self) -> NDArray[np.integer] | None:
        """Where each unknown stands when they are sorted by bricks, ``(size,)``.

        None where they are so few that a cache holds them all in any order.
        """
        from tomo.grid.bricks import brick_places  # compiled code

        return brick_places(self.mask) if self.size > _FEW else None

    @cached_property
    def place_of_voxel(self) -> NDArray[np.integer]:
        """The `place` of every voxel, else its number; -1 where inactive: ``(grid.size,)``."""
        if self.place is None:
            return self.number
        place = np.full_like(self.number, -1)
        place[slice(None) if self.index is None else self.index] = self.place
        return place

    @cached_property
    def at_place(self) -> NDArray[np.integer] | None:
        """Which unknown stands at each `place`, ``(size,)``; None where there are none."""
        if self.place is None:
            return None
        unknown = np.zeros_like(self.place)
        unknown[self.place] = np.arange(self.size, dtype=unknown.dtype)
        return unknown

    def to_places(self, values: NDArray) -> NDArray:
        """Return the unknowns' values in the order of their places; themselves without such."""
        return values if self.at_place is None else values.take(self.at_place)

    def from_places(self, values: NDArray) -> NDArray:
        """Return in the unknowns' order what is in that of their places; undoes `to_places`."""
        return values if self.place is None else values.take(self.place)

    @cached_property
    def box(self) -> ActiveVoxels:
        """The unknowns in the smallest box that holds them and a layer around, inside the grid.

        Volumes of no more than that are small. The box is a grid of the same spacing, of one voxel
        where there is no unknown; where it stands in the world plays no part.
        """
        if self.all:
            return self
        shape, inside = (1, 1, 1), np.zeros((3, 0), np.int64)
        if self.size:
            places = np.stack(np.unravel_index(self.index, self.grid.shape))  # (3, n)
            first = np.maximum(places.min(axis=1) - 1, 0)
            last = np.minimum(places.max(axis=1) + 1, np.asarray(self.grid.shape) - 1)
            shape, inside = tuple((last - first + 1).tolist()), places - first[:, None]
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
