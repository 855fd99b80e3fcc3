"""What every projection operator is: rows are pixels grouped by view, columns are unknowns."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from tomo._compute.arrays import host
from tomo.grid import ActiveVoxels, VoxelGrid

VOXEL, LINEAR = "voxel", "linear"
"""Basis functions of the emission: even within each voxel, or linear between voxel centres."""

Matrix = tuple[
    NDArray[np.int64], NDArray[np.int64], NDArray[np.unsignedinteger], NDArray[np.floating]
]
"""``starts, stops, voxel, length``: pixel ``p`` owns the entries ``starts[p]:stops[p]``."""


class ProjectionOperator(LinearOperator):
    """A linear operator ``A`` from the unknowns to the pixels that knows its views.

    ``A @ x`` takes the unknowns ``(unknowns,)`` to the images ``(pixels,)``, view after view;
    ``A.T @ y`` is its exact adjoint, which `tomo.dot_test` measures. Both return the type of
    their argument, float32 or float64. Subclasses compute ``_matvec`` and ``_rmatvec`` and take
    some of the rows.

    Parameters
    ----------
    view_ptr : (views + 1,) int, optional
        The first pixel of each view, and the number of pixels; one view when None.
    dtype : float32 or float64
        The type of the matrix entries.
    active : ActiveVoxels, optional
        The voxels that are unknowns, one a column; all of the grid when None.

    Raises
    ------
    ValueError
        If the active voxels belong to another grid, or ``view_ptr`` does not ascend from 0 to the
        number of pixels.
    """

    matrix: Matrix | None = None
    """The stored entries; None where the operator stores none that solvers may go through."""

    @property
    def basis(self) -> str:
        """The basis functions that the unknowns are coefficients of: `VOXEL` or `LINEAR`."""
        return VOXEL

    @property
    def rows_are_single_rays(self) -> bool:
        """Whether a row holds the rays of its own pixel alone, not those of neighbours."""
        return True

    @property
    def is_stored(self) -> bool:
        """Whether the entries of the rays are stored: unknowns can then be left out."""
        return False

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
        """Number of segments of rays in voxels."""

    @abstractmethod
    def rows(self, start: int, stop: int) -> Self:
        """Return the operator of pixels ``start:stop`` as one view; nothing large is copied."""

    @abstractmethod
    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        """Return the operator of some pixels, grouped into views by ``view_ptr``."""

    def packed(self) -> Self:
        """Return the same operator with its rows next to each other in memory."""
        return self

    @property
    def without_blur(self) -> ProjectionOperator:
        """The operator of the rays in voxels, before an image blur; itself where none is."""
        return self

    @property
    def without_absorption(self) -> ProjectionOperator:
        """The operator of the same rays through transparent gas, where it is not stored."""
        return self

    def with_rays(self, change: Callable[[ProjectionOperator], ProjectionOperator]) -> Self:
        """Return the same composition on other rays: ``change`` takes and returns those."""
        return change(self)

    def of_unknowns(self, kept: NDArray[np.bool_]) -> Self:
        """Return the operator of unknowns ``kept`` (unknowns,) bool; ValueError: not stored."""
        if not self.is_stored:
            raise ValueError("unknowns to keep: found entries that are not stored")
        return self.with_rays(lambda rays: rays.of_unknowns(kept))

    def voxel_means(self, volume: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the mean emission in every voxel of coefficients, both ``(nx, ny, nz)``."""
        return volume

    @property
    def on_voxel_means(self) -> ProjectionOperator:
        """The operator that takes the mean emission of every voxel to the same images."""
        return self

    @property
    def n_views(self) -> int:
        """Number of views."""
        return len(self.view_ptr) - 1

    @property
    def views_with_pixels(self) -> NDArray[np.int64]:
        """The numbers of the views that have any row."""
        return np.flatnonzero(np.diff(self.view_ptr))

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Sum of every row, ``A 1``, ``(pixels,)``: the length of a pixel's rays in the grid."""
        return self @ np.ones(self.shape[1])

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """Sum of every column, ``A^T 1``, ``(unknowns,)``; 0 where no ray meets the unknown."""
        return self.T @ np.ones(self.shape[0])

    def _transpose(self) -> LinearOperator:
        return self._adjoint()  # scipy's own copies both vectors to conjugate them

    def array(self, values: Any) -> Any:
        """Return values where products are computed, in NumPy's arrays for the CPU.

        Products of such an array, and what is computed of them, stay there.
        """
        return host(values)

    def takes(self, values: Any) -> bool:
        """Return whether products of another library's array are arrays of that library."""
        return False

    def computing(self) -> AbstractContextManager[None]:
        """Return the context in which arrays are computed with that `array` returned."""
        return nullcontext()

    def view(self, number: int) -> Self:
        """Return the operator of one view."""
        return self.rows(int(self.view_ptr[number]), int(self.view_ptr[number + 1]))

    def subset(self, views: Sequence[int]) -> Self:
        """Return the operator of some views, in the order given."""
        counts = [0, *(self.view_ptr[v + 1] - self.view_ptr[v] for v in views)]
        return self._taken(self.pixels_of(views), np.cumsum(counts))

    def pixels_of(self, views: Sequence[int]) -> NDArray[np.int64]:
        """Return the pixel numbers of ``views``, one after another; ValueError: there is none."""
        for view in views:
            if not 0 <= view < self.n_views:
                raise ValueError(f"view: found {view}, expected 0 to {self.n_views - 1}")
        spans = [np.arange(self.view_ptr[v], self.view_ptr[v + 1]) for v in views]
        return np.concatenate([np.zeros(0, np.int64), *spans])

    def take(self, pixels: NDArray[np.integer]) -> Self:
        """Return the operator of some pixels; views stay views. ValueError: they do not ascend."""
        if (np.diff(pixels) <= 0).any():
            raise ValueError("pixels to take: expected ascending numbers")
        return self._taken(pixels, np.searchsorted(pixels, self.view_ptr))


def as_float(vector: NDArray) -> NDArray:
    """Return float32 and float64 as they are, everything else as float64."""
    if vector.dtype in (np.float32, np.float64):
        return np.ascontiguousarray(vector)
    return vector.astype(np.float64)


def dot_test(operator: LinearOperator, seed: int = 0, dtype: DTypeLike = np.float64) -> float:
    """Return the relative error of an operator's adjoint.

    Parameters
    ----------
    seed : int
        Seed of the random vectors.
    dtype : {float64, float32}
        Type of the vectors.

    Notes
    -----
    ``|<A x, y> - <x, A^T y>| / (||A x|| ||y||)`` for normal random ``x`` and ``y``: about 1e-16 in
    float64 and 1e-8 in float32 for a matched pair. Every operator of the toolkit stays below 1e-12
    and 1e-6.
    """
    random = np.random.default_rng(seed)
    x = random.standard_normal(operator.shape[1]).astype(dtype)
    y = random.standard_normal(operator.shape[0]).astype(dtype)
    forward, adjoint = operator @ x, operator.T @ y
    in_images = np.dot(forward.astype(np.float64), y.astype(np.float64))
    in_volume = np.dot(x.astype(np.float64), adjoint.astype(np.float64))
    scale = np.linalg.norm(forward.astype(np.float64)) * np.linalg.norm(y.astype(np.float64))
    return float(abs(in_images - in_volume) / max(scale, np.finfo(np.float64).tiny))


class ArrayProducts(ProjectionOperator):
    """A projection operator whose products stay where their argument is, if it `takes` that."""

    @abstractmethod
    def takes(self, values: Any) -> bool:
        """Return whether an argument is another library's array that its product stays with."""

    @abstractmethod
    def product_there(self, x: Any) -> Any:
        """Return ``A x`` of an array that it takes, ``(unknowns,)`` or ``(unknowns, columns)``."""

    @abstractmethod
    def transposed_product_there(self, y: Any) -> Any:
        """Return ``A^T y`` of an array that it takes, ``(pixels,)`` or ``(pixels, columns)``."""

    def dot(self, x: Any) -> Any:
        """Return ``A @ x``."""
        return self.product_there(x) if self.takes(x) else super().dot(x)

    def _adjoint(self) -> LinearOperator:
        return _Adjoint(self)


class _Adjoint(LinearOperator):
    """``A.T``, which takes the same arrays."""

    def __init__(self, of: ArrayProducts) -> None:
        self.of = of
        super().__init__(dtype=of.dtype, shape=of.shape[::-1])

    def takes(self, values: Any) -> bool:
        """Return whether a product stays where its argument is."""
        return self.of.takes(values)

    def dot(self, y: Any) -> Any:
        """Return ``A.T @ y``."""
        return self.of.transposed_product_there(y) if self.takes(y) else super().dot(y)

    def _matvec(self, y: NDArray) -> NDArray:
        return self.of._rmatvec(y)

    def _matmat(self, y: NDArray) -> NDArray:
        return self.of._rmatmat(y)

    def _rmatvec(self, x: NDArray) -> NDArray:
        return self.of._matvec(x)

    def _rmatmat(self, x: NDArray) -> NDArray:
        return self.of._matmat(x)

    def _adjoint(self) -> LinearOperator:
        return self.of

    def _transpose(self) -> LinearOperator:
        return self.of
