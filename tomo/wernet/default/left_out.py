"""The pixels that weights are learned without, and judged by."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.selection import Choice, solve_as_chosen
from tomo.selection.folds import (
    FEW_VIEWS,
    Fold,
    blocks_to_leave_out,
    runs_of_pixels,
    surely_lower,
)
from tomo.wernet.default.correction import ViewParameters
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import parametric_corrections, reweighted


class Judged(NamedTuple):
    """Weights with the volume that they make of the training pixels.

    ``volume``, (unknowns,) float32, holds the means of the voxels; ``errors`` are the squared
    errors of the left-out pixels, one number a block, and ``of_means`` those of the blocks'
    means, see `Fold.squared_means`; ``training_residual`` is relative.
    """

    volume: NDArray[np.float32]
    errors: NDArray[np.float64]
    of_means: NDArray[np.float64]
    training_residual: float

    def surely_better_than(self, other: Judged) -> bool:
        """Return whether the means of left-out blocks are predicted better, by more than chance.

        Noise averages out in them, and details finer than voxels, which false terms imitate.
        """
        return surely_lower(self.of_means, other.of_means)


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Pixels to learn from, and left-out pixels that decide whether what was learned is kept.

    Every eighth block of pixels is left out, of all images alike: from the volume, from the terms
    and from the training of an encoder. With few views all of one view is left out as well: the
    few would teach what is wrong with each of them, and predict their own pixels by it. All
    decisions are made on these pixels, by one rule.

    Attributes
    ----------
    projector : ProjectionOperator
        Of all pixels; its entries are segment lengths.
    measured : (pixels,) float32
    held : (pixels,) bool
        True where a pixel is left out.
    blocks : (pixels,) int
        Pixels of a block are left out together.
    weights : (pixels,) float32, optional
        Weights of the squared residuals; all 1 when None.
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

    def judge(self, weighted: ProjectionOperator, choice: Choice) -> Judged:
        """Solve the training pixels as chosen with some weights, and predict the others."""
        fold = self._fold(weighted)
        found = solve_as_chosen(
            fold.training, fold.training_pixels, choice, weights=fold.training_weights
        )
        active = weighted.active
        unknowns = active.compress(found.volume)
        means = active.compress(weighted.voxel_means(found.volume))
        errors, of_means = fold.squared_errors(unknowns), fold.squared_means(unknowns)
        return Judged(means, errors, of_means, found.relative_residual)

    def judge_terms(
        self, features: RayFeatures, parameters: ViewParameters, choice: Choice, unit: float
    ) -> Judged:
        """Do so with gains and global terms.

        The upstream emission needs a volume itself: where its coefficient is not zero the solve is
        done a second time with that of the first.
        """
        upstream = torch.zeros_like(features.length)
        for _ in range(2 if parameters.coefficients[1] else 1):
            correction = parametric_corrections(parameters, features, upstream)
            judged = self.judge(reweighted(self.projector, correction), choice)
            upstream = features.upstream_emission(judged.volume, unit)
        return judged

    @cached_property
    def unit(self) -> float:
        """The root mean square of the measured pixels, the unit of the upstream emission."""
        return float(np.sqrt(np.mean(np.square(self.measured, dtype=np.float64)))) or 1.0

    def residual(self, judged: Judged | None) -> float:
        """Return the relative residual of left-out pixels; NaN for None."""
        return float(np.sqrt(judged.errors.sum() / self._light)) if judged else np.nan

    @cached_property
    def _light(self) -> float:
        return self._fold(self.projector).squared_light or 1.0

    def _fold(self, weighted: ProjectionOperator) -> Fold:
        return Fold.leaving_out(self.held, weighted, self.measured, self.weights, self.blocks)
