"""What every projector shares: its rows are pixels, grouped by view, its columns active voxels."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.grid import ActiveVoxels, VoxelGrid


class ProjectionOperator(LinearOperator):
    """A linear operator from voxels to pixels that knows its views.

    Subclasses compute ``_matvec`` and ``_rmatvec`` and say how to take some of the rows.

    Parameters
    ----------
    n_pixels : int
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.
    dtype : float32 or float64
        Of the matrix entries.
    active : ActiveVoxels, optional
        The voxels that are unknowns, one a column; all of the grid when None.
    """

    faint: ClassVar[float] = 5e-4
    """Strength of a penalty on differences of neighbours that tames what the unknowns make of
    clean images and leaves their detail."""

    edged: ClassVar[bool] = True
    """Whether the unknowns have edges that no flame has. Least squares make up for those by
    contrast, and views left out, which see them too, do not say when it is enough."""

    def __init__(
        self,
        n_pixels: int,
        grid: VoxelGrid,
        view_ptr: ArrayLike | None,
        dtype: DTypeLike,
        active: ActiveVoxels | None = None,
    ) -> None:
        self.grid = grid
        self.active = ActiveVoxels(grid) if active is None else active
        if self.active.grid != grid:
            raise ValueError(f"active: found voxels of {self.active.grid}, expected of {grid}")
        self.view_ptr = np.asarray([0, n_pixels] if view_ptr is None else view_ptr, np.int64)
        steps = np.diff(self.view_ptr)
        if self.view_ptr[0] != 0 or self.view_ptr[-1] != n_pixels or (steps < 0).any():
            raise ValueError(f"view_ptr: expected ascending from 0 to {n_pixels} pixels")
        super().__init__(dtype=dtype, shape=(n_pixels, self.active.size))

    @property
    @abstractmethod
    def n_segments(self) -> int:
        """How many crossings of rays with voxels there are: the matrix's entries."""

    @abstractmethod
    def rows(self, start: int, stop: int) -> Self:
        """Return the projector of pixels ``start:stop`` as one view; nothing large is copied."""

    @abstractmethod
    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        """Return the projector of some pixels, grouped into views by ``view_ptr``."""

    def averages(self, volume: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the mean emission in every voxel, ``(nx, ny, nz)``, of unknowns so laid out."""
        return volume

    @property
    def of_averages(self) -> ProjectionOperator:
        """The same images of a volume of `averages`."""
        return self

    @property
    def n_views(self) -> int:
        """Number of views."""
        return len(self.view_ptr) - 1

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Length of every pixel's rays inside the grid, ``(pixels,)``: ``A 1``."""
        return self @ np.ones(self.shape[1])

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """Length of all rays inside every active voxel, ``(voxels,)``: ``A^T 1``; 0 is unseen."""
        return self.T @ np.ones(self.shape[0])

    def _transpose(self) -> LinearOperator:
        return self._adjoint()  # scipy's own copies both vectors to conjugate them

    def view(self, number: int) -> Self:
        """Return the projector of one view."""
        return self.rows(int(self.view_ptr[number]), int(self.view_ptr[number + 1]))

    def subset(self, views: Sequence[int]) -> Self:
        """Return the projector of some views, in the order given."""
        counts = [0, *(self.view_ptr[v + 1] - self.view_ptr[v] for v in views)]
        return self._taken(self.pixels_of(views), np.cumsum(counts))

    def pixels_of(self, views: Sequence[int]) -> NDArray[np.int64]:
        """Return the pixel numbers of ``views``, one view after another.

        Raises
        ------
        ValueError
            If there is no view of such a number.
        """
        for view in views:
            if not 0 <= view < self.n_views:
                raise ValueError(f"view: found {view}, expected 0 to {self.n_views - 1}")
        spans = [np.arange(self.view_ptr[v], self.view_ptr[v + 1]) for v in views]
        return np.concatenate([np.zeros(0, np.int64), *spans])

    def take(self, pixels: NDArray[np.integer]) -> Self:
        """Return the projector of some pixels; views stay views.

        Raises
        ------
        ValueError
            If the pixel numbers are not ascending.
        """
        if (np.diff(pixels) <= 0).any():
            raise ValueError("pixels to take: expected ascending numbers")
        return self._taken(pixels, np.searchsorted(pixels, self.view_ptr))


def as_float(vector: NDArray) -> NDArray:
    """Return float32 and float64 as they are, everything else as float64."""
    if vector.dtype in (np.float32, np.float64):
        return np.ascontiguousarray(vector)
    return vector.astype(np.float64)
