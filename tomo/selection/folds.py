"""Folds of cross-validation: reconstruct without some pixels or views, and predict those."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import host
from tomo._compute.grouping import golden_ratio_sequence
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator

FEW_VIEWS = 8
"""Views up to which each one counts: too few to fit what is each view's own."""

LEFT_OUT = 1 / 8
"""Fraction of the pixel blocks that a fold leaves out. A larger one makes the training see less
than the whole solve will, a smaller one leaves fewer pixels to decide by."""

RUN = 3
"""Pixels in a row that are left out together where no blocks are given."""


def surely_lower(errors: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether the sum of ``errors`` is below that of ``others`` by more than chance.

    Parameters
    ----------
    errors, others : (blocks,)
        Squared errors of the same left-out blocks by two models.

    Notes
    -----
    The differences of the blocks are paired: what both models miss cancels. Their sum must exceed
    its standard error, ``sqrt(blocks) std(differences)``: the one-standard-error rule (Breiman,
    Friedman, Stone and Olshen, "Classification and Regression Trees", 1984, section 3.4.3).
    """
    less = others - errors
    return bool(less.sum() > math.sqrt(len(less)) * less.std())


def runs_of_pixels(projector: ProjectionOperator) -> NDArray[np.int64]:
    """Return a block number for each pixel, ``(pixels,)``: `RUN` pixels of a view in a row."""
    counts = np.diff(projector.view_ptr)
    of_view = -(-counts // RUN)
    first = np.repeat(np.cumsum(of_view) - of_view, counts)
    within = np.arange(projector.shape[0]) - np.repeat(projector.view_ptr[:-1], counts)
    return first + within // RUN


def blocks_to_leave_out(blocks: NDArray[np.int64], number: int = 0) -> NDArray[np.bool_]:
    """Return which pixels a fold leaves out, ``(pixels,)`` bool.

    Parameters
    ----------
    blocks : (pixels,) int
        The block of each pixel. Its number alone decides, whichever other pixels there are.
    number : int
        The fold's; the first ``1 / LEFT_OUT`` folds leave out each block once.
    """
    where = golden_ratio_sequence(int(blocks.max(initial=-1)) + 1)[blocks]
    return np.floor(where / LEFT_OUT).astype(np.int64) == number


@dataclass(frozen=True, eq=False)
class Fold:
    """Pixels to reconstruct from, and left-out pixels to predict.

    Attributes
    ----------
    training, left_out : ProjectionOperator
    training_pixels, left_out_pixels : (pixels,) float32
        Those of the training where its products are computed.
    blocks : (left-out pixels,) int64
        Consecutive numbers: errors are summed over the pixels of a block.
    training_weights, left_out_weights : (pixels,) float32, optional
        Weights of the squared residuals, in training and evaluation; all 1 when None.
    """

    training: ProjectionOperator
    training_pixels: NDArray[np.float32]
    left_out: ProjectionOperator
    left_out_pixels: NDArray[np.float32]
    blocks: NDArray[np.int64]
    training_weights: NDArray[np.float32] | None = None
    left_out_weights: NDArray[np.float32] | None = None

    @classmethod
    def leaving_out(
        cls,
        held: NDArray[np.bool_],
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        weights: NDArray[np.float32] | None = None,
        blocks: NDArray[np.int64] | None = None,
    ) -> Fold:
        """Return the fold that trains on all pixels but those ``held``, ``(pixels,)`` bool.

        Left-out pixels that see no voxel are set to 0: every fit predicts 0 there, and their light
        would only hide differences.
        """
        training, own = np.flatnonzero(~held), np.flatnonzero(held)
        trained, evaluated = projector.take(training), projector.take(own)
        of_pixel = np.arange(len(own)) if blocks is None else blocks[own]
        return cls(
            trained,
            trained.array(measured[training]),
            evaluated,
            np.where(evaluated.row_sums > 0, measured[own], np.float32(0)),
            np.unique(of_pixel, return_inverse=True)[1],
            None if weights is None else trained.array(weights[training]),
            None if weights is None else weights[own],
        )

    def squared_errors(self, volume: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the squared error of every left-out block, ``(blocks,)``, weighted."""
        predicted = host(self.left_out @ volume)
        squares = np.square((predicted - self.left_out_pixels).astype(np.float64))
        if self.left_out_weights is not None:
            squares *= self.left_out_weights
        return np.bincount(self.blocks, squares).astype(np.float64, copy=False)

    @property
    def n_blocks(self) -> int:
        """Number of left-out blocks."""
        return int(self.blocks.max()) + 1

    @cached_property
    def squared_light(self) -> float:
        """The squared error of an empty volume."""
        weights = self.left_out_weights
        pixels = self.left_out_pixels
        return norm(pixels if weights is None else np.sqrt(weights) * pixels) ** 2
