"""The pixels that weights are learned without, and judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.selection import Choice, choose_by_left_out_pixels, solve_as_chosen
from tomo.selection.folds import FEW_VIEWS, Fold, blocks_to_leave_out, runs_of_pixels


class Judged(NamedTuple):
    """What weights make of the training pixels.

    ``unknowns`` (unknowns,) float32 are those of the operator; ``errors`` are the squared errors
    of the left-out pixels, one number a block; ``training_residual`` is relative.
    """

    unknowns: NDArray[np.float32]
    errors: NDArray[np.float64]
    training_residual: float


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Pixels to learn from, and left-out pixels that decide whether what was learned is kept.

    Every eighth block of pixels is left out, of all images alike, from the volume and from the
    training of an encoder. With few views all of one is left out as well: the few would teach what
    is wrong with each of them, and predict their own pixels by it. ``projector`` has all pixels,
    its entries segment lengths; ``held`` (pixels,) are left out, those of one of ``blocks``
    together.
    """

    projector: ProjectionOperator
    measured: NDArray[np.float32]
    held: NDArray[np.bool_]
    blocks: NDArray[np.int64]
    weights: NDArray[np.float32] | None = None

    @classmethod
    def of(
        cls,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        blocks: NDArray[np.int64] | None = None,
        weights: NDArray[np.float32] | None = None,
    ) -> LeftOut:
        """Leave out every eighth block of pixels that see a voxel; short rows when None."""
        blocks = runs_of_pixels(projector) if blocks is None else blocks
        held = blocks_to_leave_out(blocks)
        views = projector.views_with_pixels
        if 1 < len(views) <= FEW_VIEWS:
            held[projector.pixels_of([views[len(views) // 2]])] = True
        return cls(projector, measured, held & (projector.row_sums > 0), blocks, weights)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<LeftOut: {np.count_nonzero(self.held)} of {len(self.held)} pixels>"

    def choose(self, weighted: ProjectionOperator) -> Choice:
        """Choose how smooth volumes are, with some weights, for all pixels."""
        how = {"blocks": self.blocks, "weights": self.weights}
        return choose_by_left_out_pixels(weighted, self.measured, **how)

    def judge(self, weighted: ProjectionOperator, choice: Choice) -> Judged:
        """Solve the training pixels as chosen with some weights, and predict the others."""
        fold = self._fold(weighted)
        found = solve_as_chosen(
            fold.training, fold.training_pixels, choice, weights=fold.training_weights
        )
        unknowns = weighted.active.compress(found.volume)
        return Judged(unknowns, fold.squared_errors(unknowns), found.relative_residual)

    def residual(self, errors: NDArray[np.float64]) -> float:
        """Return the relative residual of left-out pixels, of squared errors (blocks,)."""
        return float(np.sqrt(errors.sum() / self._light))

    @cached_property
    def _light(self) -> float:
        return self._fold(self.projector).squared_light or 1.0

    def _fold(self, weighted: ProjectionOperator) -> Fold:
        return Fold.leaving_out(self.held, weighted, self.measured, self.weights, self.blocks)
