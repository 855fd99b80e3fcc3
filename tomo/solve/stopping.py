"""Which method, how smooth, how many iterations: chosen by predicting views left out.

A falling training residual does not say that the volume gets better: with few views, noise or
imperfect cameras it gets worse long before. What a reconstruction is worth shows in the views that
it did not use, so every candidate is run without some of the views and judged on those.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import solve
from tomo.reconstruction import Callback, Reconstruction
from tomo.smooth_basis import SmoothBasis
from tomo.solve._drive import check_measured, norm
from tomo.solve._trials import CHECKPOINTS, Trial, views_to_leave_out
from tomo.solve.mlem import interleaved
from tomo.viewed import ViewedOperator

METHODS = {"mlem": 28, "sart": 28}
"""The candidates and the most iterations each is given: Poisson, and least squares."""

PATIENCE = 7
"""Iterations after which a method is given up when it is far behind another."""

WIDTHS = (0.0, 0.75, 1.5, 2.25, 3.0)
"""Standard deviations of the smooth basis tried, in voxels."""

CROSSINGS_A_VOXEL = 12
MOST_SUBSETS = 12
"""MLEM runs in ordered subsets that still have as many rays through the average voxel."""

SEGMENTS_A_TRIAL = 30_000_000
"""Pixels of larger systems are thinned evenly to about this many crossings while choosing, but
not below `CROSSINGS_A_VOXEL`."""

FALLBACK = ("mlem", 1.0, 20)
"""With one or two views nothing can be left out: the method, width and iterations used then."""

Candidate = tuple[str, float, int, float]
"""Method, width, iterations, and the relative residual of the left-out views."""

Errors = list[NDArray[np.float64]]
"""For each trial the squared errors at the checkpoints."""


@dataclass(frozen=True)
class Choice:
    """How to reconstruct, and why.

    Attributes
    ----------
    method : str
    width : float
        Of the smooth basis, in voxels; 0 is none.
    iterations : int
    held_out_residual : float
        Relative residual of the left-out views at that choice (relative to all views should those
        be dark); NaN if none could be left out.
    settings : mapping
        Further arguments of the method.
    reason : str
        In words.
    tried : tuple of (method, width, iterations, held-out residual)
        The best of each candidate.
    """

    method: str
    width: float
    iterations: int
    held_out_residual: float
    settings: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ""
    tried: tuple[Candidate, ...] = ()


def choose_by_held_out_views(
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> Choice:
    """Choose method, smoothness and stop by the residual of views left out.

    First the method on plain voxels, then the smoothness for the better one, wider as long as
    that helps; the number of iterations comes with each. With noise or imperfect cameras a
    smooth basis predicts the left-out views better; with clean images it does not.

    Parameters
    ----------
    projector : ViewedOperator
        With its views; only those take part.
    measured : (pixels,)
    progress : callable, optional
        ``progress(done, total, where)``.
    """
    measured = check_measured(projector, measured)
    views = np.flatnonzero(np.diff(projector.view_ptr)).tolist()
    if len(views) < 3 or not measured.any():
        reason = "too few views to leave any out" if measured.any() else "the images are dark"
        return Choice(*FALLBACK, math.nan, reason=reason)
    wanted = math.ceil(projector.n_crossings / SEGMENTS_A_TRIAL)
    most = math.floor(projector.n_crossings / (CROSSINGS_A_VOXEL * projector.shape[1]))
    stride = max(min(wanted, most), 1)
    if stride > 1:
        thinned = interleaved(projector.shape[0], stride)[0]
        projector, measured = projector.take(thinned), measured[thinned]
    trials = [
        Trial.leaving_out(left_out, views, projector, measured)
        for left_out in views_to_leave_out(views)
    ]
    settings = {"mlem": {"subsets": _subsets(projector)}, "sart": {}}
    scale = sum(norm(trial.left_out_pixels) ** 2 for trial in trials) or norm(measured) ** 2
    tried: list[Candidate] = []
    total = len(METHODS) + len(WIDTHS) - 1

    def attempt(
        method: str, width: float, rivals: Errors | None = None
    ) -> tuple[Candidate, Errors]:
        if progress:
            progress(len(tried), total, f"choosing: {method}, smoothness {width:g}")
        arguments = {"iterations": METHODS[method], **settings[method]}
        errors = [
            trial.squared_errors(method, width, arguments, rival)
            for trial, rival in zip(trials, rivals or [None] * len(trials), strict=True)
        ]
        together = np.sum(errors, axis=0)
        stop = int(np.argmin(together))
        residual = float(np.sqrt(together[stop] / max(scale, np.finfo(float).tiny)))
        tried.append((method, width, CHECKPOINTS[stop], residual))
        return tried[-1], errors

    first, *others = METHODS
    best, errors = attempt(first, WIDTHS[0])
    for method in others:
        candidate, candidate_errors = attempt(method, WIDTHS[0], [_patient(e) for e in errors])
        if candidate[3] < best[3]:
            best, errors = candidate, candidate_errors
    for width in WIDTHS[1:]:
        candidate, candidate_errors = attempt(best[0], width, errors)
        if candidate[3] >= best[3]:
            break
        best, errors = candidate, candidate_errors
    if progress:
        progress(total, total, "")
    reason = f"left-out views are predicted best so (relative residual {best[3]:.4f})"
    return Choice(*best, settings[best[0]], reason, tuple(tried))


def _patient(errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what another method must come near: the best of ``errors``, after some iterations.

    Iterations of different methods are not worth the same, so the first few do not count.
    """
    return np.where(np.array(CHECKPOINTS) < PATIENCE, np.inf, errors.min())


def _subsets(projector: ViewedOperator) -> int:
    """Return how many ordered subsets leave each enough rays through the average voxel."""
    crossings = projector.n_crossings / projector.shape[1]
    return int(np.clip(crossings / CROSSINGS_A_VOXEL, 1, MOST_SUBSETS))


def solve_as_chosen(
    projector: ViewedOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    callback: Callback | None = None,
) -> Reconstruction:
    """Run what was chosen on all views.

    ``callback`` receives the volume itself, not the coefficients of the smooth basis.
    """
    run = getattr(solve, choice.method)
    basis = SmoothBasis(projector, choice.width) if choice.width else None

    def report(index: int, volume: NDArray[np.float32], residual: float) -> bool | None:
        return callback(index, basis.blur(volume) if basis else volume, residual)

    found = run(
        basis or projector,
        measured,
        iterations=choice.iterations,
        callback=report if callback else None,
        **choice.settings,
    )
    return replace(
        found,
        volume=basis.blur(found.volume) if basis else found.volume,
        settings={**found.settings, "smooth_width": choice.width},
        stop_reason=f"{found.stop_reason}; {choice.reason}"
        if choice.reason
        else found.stop_reason,
    )
