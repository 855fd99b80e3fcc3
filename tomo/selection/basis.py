"""Boxes or splines: which of them predicts left-out views."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tomo.operators import ProjectionOperator
from tomo.operators.vectors import check_measured
from tomo.selection.candidates import Candidates


def error_ratio(
    splines: ProjectionOperator, boxes: ProjectionOperator, measured: ArrayLike
) -> float:
    """Return the squared error of left-out views by splines over that by boxes.

    Both by non-negative least squares, stopped where the left-out views are predicted best. With
    few views pixels of the others tell: what the views leave open would hide the difference.

    Parameters
    ----------
    splines, boxes : ProjectionOperator
        The projectors of the same pixels.
    measured : (pixels,)

    Returns
    -------
    float
        NaN with fewer than three views, or dark images: nothing to judge by.
    """
    measured = check_measured(boxes, measured)
    views = np.flatnonzero(np.diff(boxes.view_ptr)).tolist()
    if len(views) < 3 or not measured.any():
        return math.nan
    errors = []
    for projector in (splines, boxes):
        candidates = Candidates.of(projector, measured, views)
        found = candidates.fit("nnls", 0.0)
        errors.append(found.pixel_error if candidates.leaves_out_pixels else found.view_error)
    ours, theirs = errors
    return ours / theirs if theirs > 0 else math.nan
