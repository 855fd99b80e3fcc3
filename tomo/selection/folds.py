"""Folds of cross-validation, of all pixels or of a slab of a large volume."""

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
from tomo.selection.smooth_solve import smooth_start

FEW_VIEWS = 8
"""Views up to which each one counts: too few to fit what is each view's own."""

LEFT_OUT = 1 / 8
"""Fraction of the pixel blocks that a fold leaves out. A larger one makes the training see less
than the whole solve will, a smaller one leaves fewer pixels to decide by."""

RUN = 3
"""Pixels in a row that are left out together where no blocks are given."""


def surely_lower(errors: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether the sum of ``errors`` is below that of ``others`` by more than chance.

    Both are squared errors (blocks,) of the same left-out blocks, by two models: what both miss
    cancels. The sum of the differences must exceed its standard error,
    ``sqrt(blocks) std(differences)``: the one-standard-error rule (Breiman, Friedman, Stone and
    Olshen, "Classification and Regression Trees", 1984, section 3.4.3).
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

    The number of a pixel's block alone decides, whichever other pixels there are. The first
    ``1 / LEFT_OUT`` folds leave out each block once.
    """
    where = golden_ratio_sequence(int(blocks.max(initial=-1)) + 1)[blocks]
    return np.floor(where / LEFT_OUT).astype(np.int64) == number


@dataclass(frozen=True, eq=False)
class Fold:
    """Pixels to reconstruct from, and left-out pixels to predict.

    Those of the training, and their weights, are where its products are computed.
    """

    training: ProjectionOperator
    training_pixels: NDArray[np.float32]  # (pixels,)
    left_out: ProjectionOperator
    left_out_pixels: NDArray[np.float32]  # (left-out pixels,)
    blocks: NDArray[np.int64]
    """(left-out pixels,): consecutive numbers, over whose pixels errors are summed."""
    training_weights: NDArray[np.float32] | None = None  # of the squared residuals; all 1: None
    left_out_weights: NDArray[np.float32] | None = None  # the same

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

    @cached_property
    def squared_light(self) -> float:
        """The squared error of an empty volume."""
        weights = self.left_out_weights
        pixels = self.left_out_pixels
        return norm(pixels if weights is None else np.sqrt(weights) * pixels) ** 2


SEGMENTS = 2_500_000
"""Segments above which a slab of the volume is solved instead of all of it. A thinner one is
mostly borders, where priors take the dark for an edge; a thicker one takes its time."""

MOSTLY = 0.5
"""Fraction of a ray's length in the slab from which on its pixel takes part."""


@dataclass(frozen=True, eq=False)
class Part:
    """The equations of a part of the volume, light of the rest taken away.

    ``pixels`` says which of all pixels these are.
    """

    projector: ProjectionOperator
    measured: NDArray[np.float32]
    pixels: NDArray[np.int64]


def part_to_choose_by(projector: ProjectionOperator, measured: NDArray[np.float32]) -> Part | None:
    """Return a slab through the middle of the emission; None where all of it is small enough.

    The slab goes across the axis along which the fewest rays leave it. Light from the rest is
    that of `smooth_start`. Only stored projections can be cut.
    """
    wanted = SEGMENTS / max(_segments_of_single_rays(projector), 1)
    if wanted >= 1 or not projector.is_stored:
        return None
    start = smooth_start(projector, measured)
    lengths = projector.row_sums
    slabs = [_slab(projector, start, axis, wanted) for axis in range(3)]
    inside = [projector @ slab.astype(np.float64) for slab in slabs]
    mostly = [one > MOSTLY * lengths for one in inside]
    leaving = [
        (lengths[rays] - one[rays]).sum() / max(one[rays].sum(), np.finfo(float).tiny)
        for one, rays in zip(inside, mostly, strict=True)
    ]
    best = int(np.argmin(leaving))
    slab, pixels = slabs[best], np.flatnonzero(mostly[best])
    if not slab.any() or not len(pixels):
        return None
    rest = projector @ np.where(slab, np.float32(0), start)
    cut = projector.of_unknowns(slab).take(pixels)
    return Part(cut, (measured - rest)[pixels], pixels)


def _segments_of_single_rays(projector: ProjectionOperator) -> float:
    """Return at most how many segments one ray a pixel would have.

    Rays over a pixel's area or an aperture multiply the segments, not what the slab shows. A ray
    of length ``l`` crosses at most ``l |(1/dx, 1/dy, 1/dz)| + 1`` voxels.
    """
    steps = float(np.linalg.norm(1 / np.asarray(projector.grid.spacing)))
    lengths = projector.row_sums
    longest = steps * float(lengths.sum(dtype=np.float64)) + np.count_nonzero(lengths)
    return min(projector.n_segments, longest)


def _slab(
    projector: ProjectionOperator, emission: NDArray[np.float32], axis: int, wanted: float
) -> NDArray[np.bool_]:
    """Return the unknowns of the planes around the middle of the emission, ``(unknowns,)`` bool.

    As many planes as hold about the fraction ``wanted`` of all rays' lengths.
    """
    active, others = projector.active, tuple(a for a in range(3) if a != axis)

    def planes(values: NDArray) -> NDArray[np.float64]:
        return active.expand(values).reshape(active.grid.shape).sum(axis=others, dtype=np.float64)

    light, work = planes(emission), planes(projector.column_sums)
    middle = int(np.searchsorted(np.cumsum(light), light.sum() / 2))
    order = np.argsort(np.abs(np.arange(len(work)) - middle), kind="stable")
    taken = order[: max(int(np.searchsorted(np.cumsum(work[order]), wanted * work.sum())), 1)]
    kept = np.zeros(active.grid.shape, bool)
    kept[tuple(taken if a == axis else slice(None) for a in range(3))] = True
    return active.compress(kept)
