"""A start for multiplicative solvers: bright where all views agree that there may be light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator

DIMMEST = 1e-4
"""Share of the brightest voxel's start that every voxel in common view has at least: a multiplied
zero would stay zero, however loudly the images ask for light."""

UNEXPLAINED = 0.01
"""The largest share of a view's light that may meet no voxel in view of all."""


def common_start(
    projector: ProjectionOperator,
    measured: NDArray[np.floating],
    views: Sequence[int] | None = None,
    smears: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return the geometric mean of the views' back-projections, ``(unknowns,)``, never negative.

    Each view smears its pixels back along its rays, ``A_v^T b_v / A_v^T 1``. The geometric mean
    over the views is dim wherever one of them is dark: already most of the way to the volume when
    the views are few, where an even start leaves ghosts in the corners that few rays cross. A
    voxel that some view cannot see starts at zero, unless the images show that there is light in
    such voxels: then its mean is over those views that see it. The sum of the images is met.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        Pixels below zero count as zero.
    views : sequence of int, optional
        Those that take part; all that have pixels when None.
    smears : (views, unknowns), optional
        What `log_smears` returned for all views, where it is needed more than once.

    References
    ----------
    Atkinson and Soria, "An efficient simultaneous reconstruction technique for tomographic
    particle image velocimetry", Experiments in Fluids 47 (2009): the multiplicative first guess.
    """
    measured = np.maximum(measured, 0).astype(np.float32)
    smears = log_smears(projector, measured) if smears is None else smears
    views = range(projector.n_views) if views is None else views
    views = [v for v in views if projector.view_ptr[v + 1] > projector.view_ptr[v]]
    log_sum = np.zeros(projector.shape[1])
    seen_by = np.zeros(projector.shape[1], np.int64)
    for view in views:
        seen = ~np.isnan(smears[view])
        log_sum[seen] += smears[view][seen]
        seen_by += seen
    x = np.exp(log_sum / np.maximum(seen_by, 1))
    x = np.where(seen_by > 0, np.maximum(x, DIMMEST * x[seen_by > 0].max(initial=0.0)), 0)
    common = seen_by == len(views)
    if _explained(projector, measured, views, common):
        x = np.where(common, x, 0)
    predicted = projector @ x
    total = sum(_of_view(projector, view, predicted).sum() for view in views)
    light = sum(_of_view(projector, view, measured).sum(dtype=np.float64) for view in views)
    return (x * (light / total if total > 0 else 0.0)).astype(np.float32)


def log_smears(
    projector: ProjectionOperator, measured: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the logarithms of every view's back-projection, NaN where it sees nothing.

    In units of the brightest pixel: ``(views, unknowns)``; minus infinity is dark.
    """
    unit = max(float(np.max(measured, initial=0.0)), np.finfo(np.float32).tiny)
    smears = np.full((projector.n_views, projector.shape[1]), np.nan)
    for view in range(projector.n_views):
        block = projector.view(view)
        pixels = np.maximum(_of_view(projector, view, measured), 0).astype(np.float64) / unit
        lengths = block.column_sums
        seen = lengths > 0
        with np.errstate(divide="ignore"):
            smears[view][seen] = np.log((block.T @ pixels)[seen] / lengths[seen])
    return smears


def _explained(projector, measured, views, common) -> bool:
    """Return whether next to all light of every view meets a voxel that all views see."""
    meets = projector @ common.astype(np.float64) > 0
    for view in views:
        pixels = _of_view(projector, view, measured).astype(np.float64)
        lost = pixels[~_of_view(projector, view, meets)].sum()
        if lost > UNEXPLAINED * pixels.sum():
            return False
    return True


def _of_view(projector: ProjectionOperator, view: int, flat: NDArray) -> NDArray:
    return flat[projector.view_ptr[view] : projector.view_ptr[view + 1]]
