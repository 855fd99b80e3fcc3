"""Weights that all views share, learned beside a volume that is known already."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.selection import Choice
from tomo.selection.folds import FEW_VIEWS
from tomo.wernet.default.correction import ViewParameters
from tomo.wernet.default.encoder_training import EncoderTraining
from tomo.wernet.default.left_out import LeftOut
from tomo.wernet.default.outer_iterations import OuterIterations
from tomo.wernet.default.ray_features import TERMS, RayFeatures
from tomo.wernet.default.ray_weights import RayWeights
from tomo.wernet.default.run import Record, run
from tomo.wernet.default.wernet import new_encoder
from tomo.wernet.micro_batches import chunk_map


@dataclass(frozen=True, eq=False)
class LearnedShared:
    """Weights that predict left-out pixels surely better than segment lengths, or none.

    Attributes
    ----------
    weights : RayWeights, optional
        None where segment lengths stay.
    terms : tuple of str
        Those of `tomo.wernet.default.ray_features.TERMS` that were found, and ``encoder`` where
        one was trained and is kept.
    residuals : (float, float)
        Relative residuals of left-out pixels, with segment lengths and with the weights; NaN where
        nothing promised enough to be tried.
    """

    weights: RayWeights | None
    terms: tuple[str, ...]
    residuals: tuple[float, float]


def learn_shared(
    pixels: LeftOut,
    choice: Choice,
    volume: NDArray[np.float32],
    *,
    iterations: int,
    seed: int = 0,
) -> LearnedShared:
    """Learn what is common to all views: global terms, and then an encoder.

    Parameters
    ----------
    pixels : LeftOut
        In the voxel basis, the segments with midpoints.
    choice : Choice
        How voxels are solved for.
    volume : (unknowns,) float32
        The solution with segment lengths. Where its residuals promise nothing, it is all that is
        looked at.
    iterations : int
        Outer iterations of an encoder at most; 0: terms alone.
    seed : int
    """
    projector = pixels.projector
    many = np.count_nonzero(np.diff(projector.view_ptr)) > FEW_VIEWS
    features = RayFeatures.of(projector, per_view=many)
    encoder = new_encoder(seed=seed, many_views=many)
    with chunk_map(torch.device("cpu")) as map_chunks:
        training = EncoderTraining(
            features,
            pixels.measured,
            encoder,
            ViewParameters(projector.n_views, encoder.channels),
            iterations=max(iterations, 1),
            seed=seed,
            map_chunks=map_chunks,
            per_view=False,
            held=pixels.held,
        )
        unit = float(np.sqrt(np.mean(np.square(pixels.measured, dtype=np.float64)))) or 1.0
        outer = OuterIterations(pixels, training, choice, unit, iterations)
        outer.find_terms(gains=False, first=volume)
        run(outer, Record(None), None, resume=False, train=True, gains=None)
    if outer.best is None:
        return LearnedShared(None, (), outer.residuals())
    weights = outer.best.weights
    found = weights.view_parameters.coefficients.tolist()
    terms = [name for name, value in zip(TERMS, found, strict=True) if value]
    terms += [] if weights.encoder.is_zero else ["encoder"]
    return LearnedShared(weights, tuple(terms), outer.residuals())
