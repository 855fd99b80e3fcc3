"""The projector A and its exact transpose: volume to images and back."""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy.sparse.linalg import LinearOperator

from tomo._compile import compiled
from tomo.grid import VoxelGrid
from tomo.segments import Segments
from tomo.viewed import ViewedOperator, as_float


@compiled(parallel=True)
def _gather(ptr, index, value, source, target):
    """Compute ``target[i] = sum of value[s] * source[index[s]]`` over ``ptr[i]:ptr[i + 1]``.

    Each sum is one thread's, in order and in double precision: the same bits on any machine.
    """
    for row in numba.prange(len(ptr) - 1):
        total = 0.0
        for slot in range(ptr[row], ptr[row + 1]):
            total += np.float64(value[slot]) * np.float64(source[index[slot]])
        target[row] = total


@compiled()
def _transpose(ptr, voxel, length, voxel_ptr, pixel, transposed):
    """Reorder a matrix in row order by columns (counting sort); pixels stay ascending."""
    for v in voxel:
        voxel_ptr[v + 1] += 1
    for v in range(len(voxel_ptr) - 1):
        voxel_ptr[v + 1] += voxel_ptr[v]
    place = voxel_ptr[:-1].copy()
    for p in range(len(ptr) - 1):
        for slot in range(ptr[p], ptr[p + 1]):
            v = voxel[slot]
            pixel[place[v]] = p
            transposed[place[v]] = length[slot]
            place[v] += 1


class Projector(ViewedOperator):
    """The stored projection matrix: entry (pixel, voxel) is the chord length.

    Parameters
    ----------
    segments : Segments
        What a tracer returned.
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.

    Notes
    -----
    Forward ``(A x)_p = sum_s l_s x_v(s)`` over the crossings ``s`` of pixel ``p``; adjoint
    ``(A^T y)_v = sum_s l_s y_p(s)`` over the crossings of voxel ``v``, from a second copy of the
    matrix in column order that is made when the adjoint is first asked for. Both sum in double
    precision and return the type of their argument (float32 or float64).

    Examples
    --------
    >>> images = A @ volume.ravel()            # doctest: +SKIP
    >>> smear = A.T @ images                   # doctest: +SKIP
    """

    def __init__(
        self, segments: Segments, grid: VoxelGrid, view_ptr: ArrayLike | None = None
    ) -> None:
        self.segments = segments
        super().__init__(segments.n_pixels, grid, view_ptr, segments.length.dtype)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Projector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_crossings(self) -> int:
        """How many crossings of rays with voxels are stored."""
        return len(self.segments)

    @cached_property
    def _columns(self) -> tuple[NDArray, NDArray, NDArray]:
        """The matrix by columns: ``ptr (voxels + 1,)``, ``pixel (S,)``, ``length (S,)``."""
        s = self.segments
        voxel_ptr = np.zeros(self.grid.size + 1, np.int64)
        few = s.n_pixels <= np.iinfo(np.int32).max
        pixel = np.zeros(len(s), np.int32 if few else np.int64)
        length = np.zeros_like(s.length)
        _transpose(s.ptr, s.voxel, s.length, voxel_ptr, pixel, length)
        return voxel_ptr, pixel, length

    def _matvec(self, x: NDArray) -> NDArray:
        x = as_float(x.ravel())
        images = np.zeros(self.shape[0], x.dtype)
        _gather(self.segments.ptr, self.segments.voxel, self.segments.length, x, images)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        volume = np.zeros(self.shape[1], y.dtype)
        _gather(*self._columns, y, volume)
        return volume

    def rows(self, start: int, stop: int) -> Projector:
        """Return the projector of pixels ``start:stop``; the entries are shared, not copied."""
        return Projector(self.segments.rows(start, stop), self.grid)

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Projector:
        return Projector(self.segments.take(pixels), self.grid, view_ptr)

    def to_scipy(self) -> scipy.sparse.csr_array:
        """Return the matrix as scipy's CSR; the entries are shared, duplicates are kept."""
        s = self.segments
        return scipy.sparse.csr_array((s.length, s.voxel, s.ptr), shape=self.shape)


def dot_test(operator: LinearOperator, seed: int = 0, dtype: DTypeLike = np.float64) -> float:
    """Return how far an operator's adjoint is from its transpose, relative to the products.

    ``|<A x, y> - <x, A^T y>| / (||A x|| ||y||)`` for normal random ``x`` and ``y``: about 1e-16
    in float64 and 1e-8 in float32 for a matched pair.

    Parameters
    ----------
    operator : LinearOperator
    seed : int
        Of the random vectors.
    dtype : {float64, float32}
        Of the vectors.
    """
    random = np.random.default_rng(seed)
    x = random.standard_normal(operator.shape[1]).astype(dtype)
    y = random.standard_normal(operator.shape[0]).astype(dtype)
    forward, adjoint = operator @ x, operator.T @ y
    in_images = np.dot(forward.astype(np.float64), y.astype(np.float64))
    in_volume = np.dot(x.astype(np.float64), adjoint.astype(np.float64))
    scale = np.linalg.norm(forward.astype(np.float64)) * np.linalg.norm(y.astype(np.float64))
    return float(abs(in_images - in_volume) / max(scale, np.finfo(np.float64).tiny))
