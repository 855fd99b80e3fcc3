"""Updates of a volume from one block of pixels after another: views, or ordered subsets.

The update of a block is ``x <- x + r C A^T W R (b - A x)`` over its pixels alone. ``R`` are the
reciprocals of the row sums of ``A``, see `tomo.operators.vectors.damped`: a voxel that only one
ray of a block grazes would take all of that ray's noise. ``C`` are the reciprocals of the column
sums, weighted by ``W``.

With a stored matrix a row is projected and its residual back-projected at once: a block reads the
entries once. Blocks are cut into parts as products are (`tomo.operators.spmv`), and the volume
stays in the order of the entries from the first block to the last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import cast

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, host, like, namespace, taken
from tomo._compute.jit import compiled
from tomo._compute.threads import threads_worth
from tomo.operators.operator import Matrix, ProjectionOperator
from tomo.operators.spmv import (
    ADDED_AT_ONCE,
    FORWARD_NANOSECONDS,
    TRANSPOSED_NANOSECONDS,
    add_row,
    part_bounds,
    parts_at_once,
    row_product,
)
from tomo.operators.vectors import damped

Sweep = Callable[[NDArray[np.float32], float, bool, NDArray[np.int64]], NDArray[np.float32]]
"""``sweep(x, relaxation, nonnegative, order)`` returns ``x`` after the updates of blocks
``order``."""


def sweep_of(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    parts: Sequence[NDArray[np.int64]],
    weights: NDArray[np.float32] | None = None,
    *,
    fair: bool = False,
) -> Sweep:
    """Return the function that updates a volume from blocks of pixels, one after another.

    ``parts`` are the ascending numbers of each block's pixels; ``weights`` (pixels,) the diagonal
    of ``W``. ``fair``: a column sum counts as at least the mean over all blocks, since random
    blocks hardly see some voxels, and would move them by the noise of the few rays that do; views
    see a voxel or not.
    """
    per_row = _per_row(projector, weights, measured)
    most = None
    if fair:
        most = like(_per_column(_column_sums(projector, weights) / len(parts)), measured)
    if projector.matrix is not None and parts:
        return _StoredSweep(projector, measured, parts, weights, per_row, most)
    blocks = [
        Block(
            projector.take(p),
            taken(measured, p),
            None if weights is None else taken(weights, p),
            taken(per_row, p),
            most,
        )
        for p in parts
    ]

    def sweep(
        x: NDArray[np.float32], relaxation: float, nonnegative: bool, order: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        for block in (blocks[number] for number in order):
            residual = block.measured - block.projector @ x
            x = block.updated(x, residual, relaxation, nonnegative)
        return x

    return sweep


class Block:
    """The update ``C A^T W R (b - A x)`` of all pixels of a projector."""

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        weights: NDArray[np.float32] | None,
        per_row: NDArray[np.float32] | None = None,
        most: NDArray[np.float32] | None = None,
    ) -> None:
        self.projector = projector
        self.measured = measured
        self.per_row = _per_row(projector, weights, measured) if per_row is None else per_row
        own = like(_per_column(_column_sums(projector, weights)), measured)
        self.per_column = own if most is None else namespace(own).minimum(own, most)

    def updated(
        self,
        x: NDArray[np.float32],
        residual: NDArray[np.float32],
        relaxation: float,
        nonnegative: bool,
    ) -> NDArray[np.float32]:
        """Return ``x`` after the update by the residual ``b - A x``."""
        x = x + relaxation * (self.per_column * (self.projector.T @ (self.per_row * residual)))
        return namespace(x).maximum(x, 0.0) if nonnegative else x


def _per_row(
    projector: ProjectionOperator,
    weights: NDArray[np.float32] | None,
    measured: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the diagonal of ``W R``; its value where a ray meets no voxel has no effect."""
    per_row = like((1 / damped(projector.row_sums)).astype(np.float32), measured)
    return per_row if weights is None else weights * per_row


def _column_sums(
    projector: ProjectionOperator, weights: NDArray[np.float32] | None
) -> NDArray[np.float64]:
    """Return ``A^T W 1``."""
    if weights is None:
        return projector.column_sums
    return host(projector.T @ as_type(weights, np.float64))


def _per_column(sums: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the diagonal of ``C``; zero where a voxel meets no ray."""
    return np.divide(1.0, sums, out=np.zeros_like(sums), where=sums > 0).astype(np.float32)


class _StoredSweep:
    """The updates of blocks of a stored matrix, with its rows in the order of the blocks."""

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        parts: Sequence[NDArray[np.int64]],
        weights: NDArray[np.float32] | None,
        per_row: NDArray[np.float32],
        most: NDArray[np.float32] | None,
    ) -> None:
        order, n_unknowns = np.concatenate(parts), projector.shape[1]
        ptr = np.cumsum([0] + [len(pixels) for pixels in parts])
        starts, stops, voxel, length = cast("Matrix", projector.matrix)
        self._active = projector.active
        self._matrix = (starts[order], stops[order], voxel, length)
        self._measured = measured[order]
        weights = np.ones(len(order), np.float32) if weights is None else weights[order]
        self._per_row = per_row[order]
        self._per_column = np.zeros((len(parts), n_unknowns), np.float32)
        _per_columns(*self._matrix, weights, ptr, self._per_column)
        if most is not None:
            np.minimum(self._per_column, self._active.to_storage(most), out=self._per_column)
        counts = self._matrix[1] - self._matrix[0]
        cuts = [
            first + part_bounds(counts[first:last], n_unknowns)
            for first, last in itertools.pairwise(ptr)
        ]
        self._bounds = np.concatenate([np.zeros(1, np.int64), *(cut[1:] for cut in cuts)])
        self._part_ptr = np.cumsum([0] + [len(cut) - 1 for cut in cuts])
        self._most = max(len(cut) - 1 for cut in cuts)
        self._nanoseconds = (FORWARD_NANOSECONDS + TRANSPOSED_NANOSECONDS) * (
            int(counts.sum()) / int(self._part_ptr[-1])
        )  # of a part

    def __call__(
        self,
        x: NDArray[np.float32],
        relaxation: float,
        nonnegative: bool,
        order: NDArray[np.int64],
    ) -> NDArray[np.float32]:
        """Return ``x`` (n,) after the updates of blocks ``order``."""
        x = np.array(self._active.to_storage(x))
        at_once = parts_at_once(self._most, x.nbytes)
        private = np.zeros((at_once, len(x)), np.float32)
        with threads_worth(self._nanoseconds * at_once):
            _sweep(
                *self._matrix, self._measured, self._per_row, self._per_column, order,
                self._part_ptr, self._bounds, np.float32(relaxation), nonnegative, private, x,
            )  # fmt: skip
        return self._active.from_storage(x)


@compiled(parallel=True)
def _per_columns(starts, stops, voxel, length, weights, ptr, per_column):
    """Write ``C`` of every block ``ptr[b]:ptr[b + 1]``: (blocks, n)."""
    for block in numba.prange(len(per_column)):
        columns = np.zeros(per_column.shape[1])
        for row in range(ptr[block], ptr[block + 1]):
            add_row(np.float64(weights[row]), voxel, length, starts[row], stops[row], columns)
        for i in range(len(columns)):
            if columns[i] > 0:
                per_column[block, i] = 1 / columns[i]


@compiled(parallel=True)
def _sweep(
    starts, stops, voxel, length, measured, per_row, per_column, order, part_ptr, bounds,
    relaxation, nonnegative, private, x,
):  # fmt: skip
    """Update ``x`` (n,) from blocks ``order``, whose parts ``part_ptr`` counts.

    The rows ``bounds[p]:bounds[p + 1]`` of each part add into a row of ``private`` (at once, n),
    which is zeros before and after; those of a block's only part add into the update itself.
    """
    n, at_once = len(x), len(private)
    update = np.zeros(n, np.float32)
    for block in order:
        end = part_ptr[block + 1]
        in_one = end - part_ptr[block] == 1  # no other part adds: no private volume is needed
        for first in range(part_ptr[block], end, at_once):
            last = min(first + at_once, end)
            if in_one:
                _back_project(
                    starts, stops, voxel, length, measured, per_row, bounds[first], bounds[last],
                    x, update,
                )  # fmt: skip
            else:
                for part in numba.prange(first, last):
                    _back_project(
                        starts, stops, voxel, length, measured, per_row, bounds[part],
                        bounds[part + 1], x, private[part - first],
                    )  # fmt: skip
            for some in numba.prange((n + ADDED_AT_ONCE - 1) // ADDED_AT_ONCE):
                low = some * ADDED_AT_ONCE
                high = min(low + ADDED_AT_ONCE, n)
                total = update[low:high]
                for part in range(0 if in_one else last - first):
                    own = private[part, low:high]
                    for i in range(len(total)):
                        total[i] += own[i]
                        own[i] = 0
                if last == end:
                    _add(relaxation, per_column[block, low:high], total, nonnegative, x[low:high])


@compiled(inline=True)
def _back_project(
    starts, stops, voxel, length, measured, per_row, first_row, end_row, x, update
):  # fmt: skip
    """Add the back-projected residuals of rows ``first_row:end_row`` to ``update`` (n,)."""
    for row in range(first_row, end_row):
        start, stop = np.int64(starts[row]), np.int64(stops[row])
        image = np.float32(row_product(x, voxel, length, start, stop))
        pixel = per_row[row] * (measured[row] - image)
        if pixel != 0:
            add_row(pixel, voxel, length, start, stop, update)


@compiled(inline=True)
def _add(relaxation, factor, update, nonnegative, x):
    """Add ``relaxation * factor * update`` to ``x``, and clear the update."""
    for i in range(len(x)):
        moved = x[i] + relaxation * (factor[i] * update[i])
        update[i] = 0
        x[i] = np.float32(0) if nonnegative and moved < 0 else moved
