"""A projector whose images are out of focus."""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from tomo._compute.index_types import numbering
from tomo.operators.operator import ProjectionOperator, as_float
from tomo.operators.spmv import gather, part_bounds, scatter
from tomo.trace import Segments


class Defocused(ProjectionOperator):
    """The projector ``B A`` of lines ``A`` whose light a lens spreads by ``B``.

    Parameters
    ----------
    lines : Projector or OnTheFlyProjector
        ``A``: of chord lengths, or weights learned in their place. `segments` and `with_lengths`
        are there for stored ones.
    spread : (pixels, lines) sparse
        ``B``: the share of each line's light in each pixel, see `spread_of`.
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; those of the lines when None.

    Raises
    ------
    ValueError
        If the spread is not one of those lines.

    Notes
    -----
    Rows are summed in double precision, and the adjoint ``A^T B^T`` goes through the same
    entries: both as `Projector` does it, the same bits on any number of threads.
    """

    def __init__(
        self,
        lines: ProjectionOperator,
        spread: scipy.sparse.csr_array,
        view_ptr: ArrayLike | None = None,
    ) -> None:
        if spread.shape[1] != lines.shape[0]:
            raise ValueError(
                f"spread: found one of {spread.shape[1]} lines, expected {lines.shape[0]}"
            )
        self.lines, self.spread = lines, spread
        view_ptr = lines.view_ptr if view_ptr is None else view_ptr
        super().__init__(spread.shape[0], lines.grid, view_ptr, lines.dtype, lines.active)

    def __repr__(self) -> str:
        """Name the lines."""
        return f"<Defocused: {self.shape[0]} pixels of {self.lines!r}>"

    @cached_property
    def _entries(self) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """The spread as compiled products take it: starts, stops, lines and shares."""
        pointers = self.spread.indptr.astype(np.int64)
        indices = self.spread.indices.astype(numbering(self.spread.shape[1]), copy=False)
        return pointers[:-1], pointers[1:], indices.view(f"u{indices.itemsize}"), self.spread.data

    @cached_property
    def _parts(self) -> NDArray[np.int64]:
        return part_bounds(np.diff(self.spread.indptr), self.spread.shape[1])

    def _matvec(self, x: NDArray) -> NDArray:
        seen = self.lines @ as_float(x.ravel())
        images = np.zeros(self.shape[0], seen.dtype)
        gather(*self._entries, seen, images, self.spread.nnz)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        gathered = np.zeros(self.spread.shape[1], y.dtype)
        scatter(*self._entries, y, self._parts, gathered, self.spread.nnz)
        return self.lines.T @ gathered

    @property
    def n_segments(self) -> int:
        """How many crossings of lines with voxels there are."""
        return self.lines.n_segments

    @property
    def segments(self) -> Segments:
        """The segments of the lines, as they are before their light is spread."""
        return self.lines.segments

    def with_lengths(self, length: NDArray[np.floating]) -> Self:
        """Return the projector with ``length`` (S,), of either sign, in place of its own."""
        return type(self)(self.lines.with_lengths(length), self.spread, self.view_ptr)

    def rows(self, start: int, stop: int) -> Self:
        """Return the projector of pixels ``start:stop`` as one view, with the lines they need."""
        return self._taken(np.arange(start, stop), np.array([0, stop - start]))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        spread = self.spread[pixels]
        needed = np.unique(spread.indices)
        return type(self)(self.lines.take(needed), spread[:, needed], view_ptr)
