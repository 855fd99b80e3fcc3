"""Images blurred by one kernel a view: an operator from pixels to pixels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo._compute.index_types import index_type
from tomo._compute.memory import available_memory
from tomo.operators.composition import ImageOperator
from tomo.operators.operator import Matrix, as_float
from tomo.operators.spmm import products, transposed_products
from tomo.operators.spmv import part_bounds, product, transposed_product

Kernel = tuple[NDArray[np.int64], NDArray[np.float32]]
"""``offsets`` (n, 2), columns and rows from a pixel, and the ``weight`` (n,) of each."""

BYTES = 24
"""Memory of one kernel weight of one pixel while the matrix is built, in bytes. Less lets a system
start that runs out of memory, more refuses one that would fit."""


class ImageBlur(ImageOperator):
    """The blur ``B`` of images: each pixel passes on its light by the weights of a kernel.

    ``blur @ images`` blurs images ``(pixels,)``; ``blur @ rays`` of a projection operator is the
    projection of blurred images.

    Parameters
    ----------
    matrix : (pixels, rays) float32 sparse
        Entry ``(p, q)``: the fraction of the light of ray ``q`` that reaches pixel ``p``. See
        `from_kernels`, `tomo.operators.lens_blur` and `tomo.operators.footprint_blur`.

    Notes
    -----
    Forward ``(B y)_p = sum_q B_pq y_q``, summed in double precision; the adjoint goes through the
    same entries. Both as in `Projector`: the same bits on any number of threads.

    Examples
    --------
    >>> out_of_focus = lens_blur(rig, pixels, grid, 0.5) @ rays    # doctest: +SKIP
    """

    def __init__(self, matrix: scipy.sparse.csr_array) -> None:
        self.matrix = matrix
        super().__init__(dtype=matrix.dtype, shape=matrix.shape)

    @classmethod
    def from_kernels(
        cls,
        rig: Rig,
        pixels: Sequence[NDArray[np.integer]],
        kernels: Sequence[Kernel],
        what: str = "image blur",
    ) -> ImageBlur:
        """Return the blur of the pixels of a rig's images by one kernel a camera.

        Parameters
        ----------
        rig : Rig
        pixels : sequence of (P_v,) int
            For each camera the flat numbers ``row * width + column`` of the pixels that take
            part; the others count as dark.
        kernels : sequence of ((n, 2) int64, (n,) float32)
            For each camera the pixels that the light of a ray reaches, in columns and rows from
            its own, and the fraction that reaches each.
        what : str
            The subject of the error about memory.

        Raises
        ------
        ValueError
            If the matrix would not fit in memory.
        """
        counts = [
            len(kept) * len(weight) for kept, (_, weight) in zip(pixels, kernels, strict=True)
        ]
        needed, available = BYTES * (max(counts) + sum(counts)), available_memory()
        if needed > available:
            raise ValueError(
                f"{what} would take about {needed / 1e9:.1f} GB, expected at most "
                f"{available / 1e9:.1f} GB: use smaller images (--scale)"
            )
        views = [
            _matrix_of_view(camera, kept, kernel)
            for camera, kept, kernel in zip(rig, pixels, kernels, strict=True)
        ]
        return cls(_side_by_side(views))

    def __repr__(self) -> str:
        """Name the size."""
        return f"<ImageBlur: {self.shape[0]} pixels>"

    @cached_property
    def _entries(self) -> Matrix:
        """The matrix as compiled products take it."""
        pointers = self.matrix.indptr.astype(np.int64)
        indices = self.matrix.indices.astype(index_type(self.matrix.shape[1]), copy=False)
        return pointers[:-1], pointers[1:], indices.view(f"u{indices.itemsize}"), self.matrix.data

    @cached_property
    def _parts(self) -> NDArray[np.int64]:
        return part_bounds(np.diff(self.matrix.indptr), self.matrix.shape[1])

    def _matvec(self, x: NDArray) -> NDArray:
        x = as_float(x.ravel())
        images = np.zeros(self.shape[0], x.dtype)
        product(*self._entries, x, images, self.matrix.nnz)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        gathered = np.zeros(self.shape[1], y.dtype)
        transposed_product(*self._entries, y, self._parts, gathered, self.matrix.nnz)
        return gathered

    def _matmat(self, x: NDArray) -> NDArray:
        return products(self._entries, x, self.matrix.nnz)

    def _rmatmat(self, y: NDArray) -> NDArray:
        pixels = self.shape[1]
        return transposed_products(self._entries, y, self._parts, pixels, self.matrix.nnz)

    def take(self, pixels: NDArray[np.integer]) -> tuple[ImageBlur, NDArray[np.int64]]:
        """Return the blur of some pixels, from the rays that reach them, and those rays."""
        matrix = self.matrix[pixels]
        reached = np.zeros(self.shape[1], bool)
        reached[matrix.indices] = True
        needed = np.flatnonzero(reached)
        number = np.cumsum(reached) - 1
        entries = matrix.data, number[matrix.indices], matrix.indptr
        return ImageBlur(scipy.sparse.csr_array(entries, (len(pixels), len(needed)))), needed

    @property
    def arrays(self) -> tuple[NDArray, ...]:
        """The columns and the weights of the entries."""
        return self.matrix.indices, self.matrix.data


def _matrix_of_view(
    camera: CameraLike, pixels: NDArray[np.integer], kernel: Kernel
) -> scipy.sparse.csr_array:
    """Return the weights between the pixels of one view: (pixels, pixels)."""
    order = np.lexsort(kernel[0].T)  # by rows, then columns: pixels are read as they lie in memory
    offsets, weight = kernel[0][order], kernel[1][order]
    reach = int(np.abs(offsets).max())
    columns, rows = camera.image_size
    number = np.full((rows + 2 * reach, columns + 2 * reach), -1)
    row, column = pixels // columns + reach, pixels % columns + reach
    number[row, column] = np.arange(len(pixels))
    near = number[row[:, None] + offsets[:, 1], column[:, None] + offsets[:, 0]]  # (pixels, n)
    there = near >= 0
    weights = np.broadcast_to(weight, near.shape)[there]
    pointers = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    return scipy.sparse.csr_array((weights, near[there], pointers), (len(pixels), len(pixels)))


def _side_by_side(views: Sequence[scipy.sparse.csr_array]) -> scipy.sparse.csr_array:
    """Return the block-diagonal matrix of the views' own; scipy's takes ten times as long."""
    pixels = np.cumsum([0, *(one.shape[0] for one in views)])
    entries = np.cumsum([0, *(one.nnz for one in views)])
    columns = [one.indices + first for one, first in zip(views, pixels[:-1], strict=True)]
    pointers = [one.indptr[1:] + first for one, first in zip(views, entries[:-1], strict=True)]
    data = np.concatenate([np.zeros(0, np.float32), *(one.data for one in views)])
    indices = np.concatenate([np.zeros(0, np.int64), *columns])
    indptr = np.concatenate([np.zeros(1, np.int64), *pointers])
    return scipy.sparse.csr_array((data, indices, indptr), (pixels[-1], pixels[-1]))
