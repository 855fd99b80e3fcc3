"""The multiplicative line-of-sight start: bright where all views allow light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import beside

DIMMEST = 1e-4
"""Fraction of the brightest voxel that every voxel in view starts with at least. At zero a
voxel stays dark whatever the images show; a larger one leaves ghosts where few rays pass."""


def mlos_start(
    projector: ProjectionOperator,
    measured: NDArray[np.floating],
    views: Sequence[int] | None = None,
    back_projections: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return the multiplicative line-of-sight (MLOS) volume, ``(unknowns,)``, never negative.

    One a column where the images have columns.

    The geometric mean of the views' back-projections is dim wherever one of them is dark: with few
    views it is most of the way to the volume, where a constant start leaves ghosts in corners that
    few rays meet. The mean of a voxel is over the views that see it. The volume reproduces the sum
    of the images.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,) or (pixels, columns)
        Pixels below zero count as zero.
    views : sequence of int, optional
        The views that take part; all that have pixels when None.
    back_projections : (views, unknowns, ...), optional
        The result of `log_back_projections` for all views, where it is needed more than once.

    Notes
    -----
    ``x = exp(mean_v log(A_v^T b_v / A_v^T 1))``, scaled to the sum of the images.

    References
    ----------
    Atkinson and Soria, "An efficient simultaneous reconstruction technique for tomographic
    particle image velocimetry", Experiments in Fluids 47 (2009): the multiplicative first guess.
    """
    measured = np.maximum(measured, 0).astype(np.float32)
    if back_projections is None:
        back_projections = log_back_projections(projector, measured)
    views = range(projector.n_views) if views is None else views
    views = [v for v in views if projector.view_ptr[v + 1] > projector.view_ptr[v]]
    log_sum = np.zeros(back_projections.shape[1:])
    seen_by = np.zeros(log_sum.shape, np.int64)
    for view in views:
        seen = ~np.isnan(back_projections[view])
        log_sum[seen] += back_projections[view][seen]
        seen_by += seen
    x = np.exp(log_sum / np.maximum(seen_by, 1))
    brightest = np.where(seen_by > 0, x, 0).max(axis=0, initial=0.0)
    x = np.where(seen_by > 0, np.maximum(x, DIMMEST * brightest), 0)
    predicted = projector @ x
    total = sum(_of_view(projector, view, predicted).sum(axis=0) for view in views)
    light = sum(_of_view(projector, view, measured).sum(axis=0, dtype=float) for view in views)
    scale = np.divide(light, total, out=np.zeros(np.shape(total)), where=np.greater(total, 0))
    return (x * scale).astype(np.float32)


def log_back_projections(
    projector: ProjectionOperator, measured: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the logarithm of every view's back-projection, NaN where it sees nothing.

    In units of the brightest pixel: ``(views, unknowns)``, with a last axis of columns where the
    images have columns; minus infinity is dark.
    """
    unit = np.maximum(np.max(measured, axis=0, initial=0.0), np.finfo(np.float32).tiny)
    unit = unit.astype(np.float64)
    shape = projector.n_views, projector.shape[1], *measured.shape[1:]
    back_projections = np.full(shape, np.nan)
    for view in range(projector.n_views):
        block = projector.view(view)
        pixels = np.maximum(_of_view(projector, view, measured), 0).astype(np.float64) / unit
        lengths = block.column_sums
        seen = lengths > 0
        with np.errstate(divide="ignore"):
            seen_of = (block.T @ pixels)[seen]
            back_projections[view][seen] = np.log(seen_of / beside(lengths[seen], seen_of))
    return back_projections


def _of_view(projector: ProjectionOperator, view: int, flat: NDArray) -> NDArray:
    return flat[projector.view_ptr[view] : projector.view_ptr[view + 1]]
