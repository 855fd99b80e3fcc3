"""Global terms that all views share, learned beside a volume that is known already."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from tomo.selection import Choice
from tomo.selection.folds import FEW_VIEWS
from tomo.wernet.default.correction import CorrectionEncoder
from tomo.wernet.default.left_out import LeftOut
from tomo.wernet.default.ray_features import TERMS, RayFeatures
from tomo.wernet.default.ray_weights import RayWeights
from tomo.wernet.default.variable_projection import fit_parametric_terms

UPSTREAM, VIGNETTING = SHARED = TERMS[1:]
"""Upstream emission and vignetting. Depth leaves the scale of the volume open: an even medium is
fitted with its scale before."""


@dataclass(frozen=True, eq=False)
class LearnedShared:
    """Weights that predict left-out pixels surely better than segment lengths, or none.

    Attributes
    ----------
    weights : RayWeights, optional
        None where segment lengths stay.
    terms : tuple of str
        Those of `SHARED` that were found.
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
    terms: Collection[str] = SHARED,
) -> LearnedShared:
    """Learn the global terms that predict left-out pixels better than segment lengths.

    Parameters
    ----------
    pixels : LeftOut
        The segments of its projector have midpoints.
    choice : Choice
        How voxels are solved for.
    volume : (unknowns,) float32
        The solution with segment lengths. Where its residuals promise nothing, it is all that is
        looked at.
    terms : collection of str
        Those of `SHARED` to look for.
    """
    projector = pixels.projector
    many = len(projector.views_with_pixels) > FEW_VIEWS
    features = RayFeatures.of(projector, per_view=many)
    lengths = cache(lambda: pixels.judge(projector, choice))
    numbers = {TERMS.index(name) for name in terms}
    parameters, tried = fit_parametric_terms(
        pixels, features, choice, pixels.unit, lengths, numbers, volume=volume
    )
    if tried is None:
        return LearnedShared(None, (), (np.nan, np.nan))
    residuals = pixels.residual(lengths()), pixels.residual(tried)
    if parameters is None:
        return LearnedShared(None, (), residuals)
    found = parameters.coefficients.tolist()
    names = tuple(name for name, value in zip(TERMS, found, strict=True) if value)
    none = CorrectionEncoder(blocks=1, channels=1)
    scale = features.image_scale
    weights = RayWeights(none, parameters, tried.volume, pixels.unit, many, scale)
    return LearnedShared(weights, names, residuals)
