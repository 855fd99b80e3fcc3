"""The multiplicative line-of-sight start: bright where all views allow light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, factors, namespace, quotient, zeros
from tomo._compute.reductions import largest, total
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import beside

DIMMEST = 1e-4
"""Fraction of the brightest voxel that every voxel in view starts with at least. At zero a
voxel stays dark whatever the images show; a larger one leaves ghosts where few rays pass."""


def mlos_start(
    projector: ProjectionOperator, measured: NDArray[np.floating]
) -> NDArray[np.float32]:
    """Return the multiplicative line-of-sight (MLOS) volume, ``(unknowns,)``, never negative.

    ``x = exp(mean_v log(A_v^T b_v / A_v^T 1))`` over the views that see a voxel, scaled to the sum
    of the images; ``b`` (pixels,) or (pixels, columns), below zero as zero; where the operator
    computes. It is dim wherever a view is dark: with few views that is most of the way to the
    volume, where a constant start leaves ghosts in corners that few rays meet.

    Atkinson and Soria, "An efficient simultaneous reconstruction technique for tomographic
    particle image velocimetry", Experiments in Fluids 47 (2009): the multiplicative first guess.
    """
    measured = projector.array(measured)
    xp = namespace(measured)
    measured = as_type(xp.maximum(measured, 0.0), np.float32)
    brightest = np.maximum(largest(measured), np.finfo(np.float32).tiny).astype(np.float64)
    pixels = as_type(measured, np.float64) / factors(brightest, measured)
    log_sum = zeros((projector.shape[1], *measured.shape[1:]), pixels)
    seen_by = zeros(log_sum.shape, pixels)
    views = projector.views_with_pixels.tolist()
    spans = [slice(*projector.view_ptr[view : view + 2].tolist()) for view in views]
    for view, own in zip(views, spans, strict=True):
        block = projector.view(view)
        lengths = block.T @ (zeros((block.shape[0],), pixels) + 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = block.T @ pixels[own, ...]
            logarithm = xp.log(seen / beside(lengths, seen))  # 0 / 0 is NaN: no ray
        unseen = xp.isnan(logarithm)
        log_sum = log_sum + xp.where(unseen, 0.0, logarithm)
        seen_by = seen_by + as_type(~unseen, np.float64)
    x = xp.exp(log_sum / xp.maximum(seen_by, 1.0))
    dimmest = DIMMEST * largest(xp.where(seen_by > 0, x, 0.0))
    x = xp.where(seen_by > 0, xp.maximum(x, factors(dimmest, x)), 0.0)
    predicted = projector @ x
    light, sums = (sum(total(one[own, ...]) for own in spans) for one in (measured, predicted))
    return as_type(x * factors(quotient(light, sums)[()], x), np.float32)
