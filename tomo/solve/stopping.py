"""Which method, how smooth, how many iterations: chosen by predicting views left out.

A falling training residual does not say that the volume gets better: with few views, noise or
imperfect cameras it gets worse long before. What a reconstruction is worth shows in the views that
it did not use, so every candidate is run without some of the views and judged on those.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import solve
from tomo._sums import norm
from tomo.reconstruction import Callback, Reconstruction
from tomo.smooth_basis import SmoothBasis
from tomo.solve._common_start import common_start
from tomo.solve._drive import check_measured
from tomo.solve._trials import CHECKPOINTS, MULTIPLICATIVE, Trial, views_to_leave_out
from tomo.solve.mlem import interleaved
from tomo.viewed import ViewedOperator

METHODS = {"mlem": 17, "nnls": 40}
"""The candidates and the most iterations each is given: Poisson, and least squares."""

FAINT = 5e-4
"""Strength of the penalty that least squares are run with in the end, with as many iterations."""

WORTH_ITS_DETAIL = 0.7
"""That penalty is left out where without it the left-out views' squared error is below this share.
Boxes alone predict clean images a little better and are further from the truth: they make up for
their width by contrast. Where the light itself is as rough as boxes they predict far better."""

FEW_VIEWS = 8
"""Up to so many views both methods are tried: what the views leave open MLEM fills with what all
of them allow. With more views least squares has been the better one throughout."""

WIDTHS = (0.0, 0.5, 0.8, 1.2, 1.8, 2.7)
"""Standard deviations of the smooth basis tried, in voxels; the first step above none is left out
with few views, which do not resolve single voxels."""

WORTH_WIDENING = 0.1
"""A wider basis must gain so much of what all smoothing has gained: what it gains less is chance,
and detail is lost for it."""

SEGMENTS_A_TRIAL = 2_500_000
PIXELS_AN_UNKNOWN = 8
"""Pixels of larger systems are thinned evenly to about so many crossings while choosing. Where
there are more pixels than unknowns, so many an unknown stay: a system that is no longer
overdetermined would ask for more smoothness than the whole one."""

FALLBACK = ("mlem", 1.0, 10)
"""With one or two views nothing can be left out: the method, width and iterations used then."""

Candidate = tuple[str, float, int, float]
"""Method, width, iterations, and the relative residual of the left-out views."""


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
    reason : str
        In words.
    tried : tuple of (method, width, iterations, held-out residual)
        The best of each candidate.
    """

    method: str
    width: float
    iterations: int
    held_out_residual: float
    reason: str = ""
    tried: tuple[Candidate, ...] = ()

    @property
    def settings(self) -> Mapping[str, Any]:
        """Further arguments of the method."""
        return {"strength": FAINT} if self.method == "tikhonov" else {}

    def solves_as(self, other: Choice) -> bool:
        """Return whether both solve the same way, however well that predicts left-out views."""
        ours, theirs = ((one.method, one.width, one.iterations) for one in (self, other))
        return ours == theirs


def choose_by_held_out_views(
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    progress: Callable[[int, int, str], None] | None = None,
) -> Choice:
    """Choose method, smoothness and stop by the residual of views left out.

    First the method on plain voxels, then the smoothness for the better one, wider as long as
    that helps; the number of iterations comes with each. Least squares are then given a faint
    penalty on differences of neighbours, unless the left-out views, of more than a few, speak
    clearly against it. With noise, few views or imperfect cameras a smooth basis predicts the
    left-out views better; with clean images it does not.

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
    trials, scale = _trials_of(projector, measured, views)
    tried: list[Candidate] = []
    few = len(views) <= FEW_VIEWS
    methods = ["mlem", "nnls"] if few else ["nnls"]
    widths = WIDTHS[:1] + WIDTHS[2:] if few else WIDTHS
    total = len(methods) + len(widths) - few

    def attempt(method: str, width: float, best: Sequence[float], **settings: Any) -> list[float]:
        if progress:
            progress(len(tried), total, f"choosing: {method}, smoothness {width:g}")
        arguments = {"iterations": METHODS.get(method), **settings}
        errors = [
            trial.squared_errors(method, width, arguments, rival)
            for trial, rival in zip(trials, best, strict=True)
        ]
        together = np.sum(errors, axis=0)
        stop = int(np.argmin(together))
        residual = float(np.sqrt(together[stop] / max(scale, np.finfo(float).tiny)))
        tried.append((method, width, CHECKPOINTS[stop], residual))
        return [float(error[stop]) for error in errors]

    errors = attempt(methods[0], widths[0], [0.0] * len(trials))
    best = tried[0]
    for method in methods[1:]:
        found = attempt(method, widths[0], errors)
        if tried[-1][3] < best[3]:
            best, errors = tried[-1], found
    plain = best[3]
    for width in widths[1:]:
        found = attempt(best[0], width, errors)
        gained = best[3] ** 2 - tried[-1][3] ** 2
        if gained <= WORTH_WIDENING * (plain**2 - best[3] ** 2):
            break
        best, errors = tried[-1], found
    if not few:
        faint = Choice("tikhonov", best[1], best[2], math.nan)
        attempt(
            faint.method, faint.width, [0.0] * len(trials), iterations=best[2], **faint.settings
        )
        if best[3] ** 2 >= WORTH_ITS_DETAIL * tried[-1][3] ** 2:
            # Iterations stay: the penalty is to make a volume tamer, not to go on for longer.
            best = tried[-1] = (faint.method, faint.width, best[2], tried[-1][3])
    if progress:
        progress(total, total, "")
    reason = f"left-out views are predicted best so (relative residual {best[3]:.4f})"
    return Choice(*best, reason=reason, tried=tuple(tried))


def residual_of_left_out_views(
    projector: ViewedOperator, measured: ArrayLike, choice: Choice
) -> float:
    """Return the relative residual of views left out when it is done as ``choice`` says.

    Of the views that `choose_by_held_out_views` leaves out; NaN where it could leave out none.
    """
    measured = check_measured(projector, measured)
    if math.isnan(choice.held_out_residual):
        return math.nan
    views = np.flatnonzero(np.diff(projector.view_ptr)).tolist()
    trials, scale = _trials_of(projector, measured, views)
    squared = 0.0
    for trial in trials:
        found = solve_as_chosen(trial.training, trial.training_pixels, choice)
        seen = trial.left_out @ projector.live.compress(found.volume)
        squared += norm(seen - trial.left_out_pixels) ** 2
    return math.sqrt(squared / max(scale, np.finfo(float).tiny))


def _trials_of(
    projector: ViewedOperator, measured: NDArray[np.float32], views: Sequence[int]
) -> tuple[list[Trial], float]:
    """Return the trials, and the squared norm to judge their left-out pixels by."""
    stride = _stride(projector)
    if stride > 1:
        thinned = interleaved(projector.shape[0], stride)[0]
        projector, measured = projector.take(thinned), measured[thinned]
    trials = [
        Trial.leaving_out(left_out, views, projector, measured)
        for left_out in views_to_leave_out(views)
    ]
    scale = sum(norm(trial.left_out_pixels) ** 2 for trial in trials) or norm(measured) ** 2
    return trials, scale


def _stride(projector: ViewedOperator) -> int:
    """Return of how many pixels one takes part while choosing."""
    pixels, unknowns = projector.shape
    wanted = math.ceil(projector.n_crossings / SEGMENTS_A_TRIAL)
    if pixels > unknowns:
        wanted = min(wanted, pixels // (PIXELS_AN_UNKNOWN * max(unknowns, 1)))
    return max(wanted, 1)


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

    start = None
    if choice.method in MULTIPLICATIVE:
        start = common_start(projector, check_measured(projector, measured))
    found = run(
        basis or projector,
        measured,
        start=start,
        iterations=choice.iterations,
        callback=report if callback else None,
        **choice.settings,
    )
    return replace(
        found,
        volume=basis.volume(found.volume) if basis else found.volume,
        settings={**found.settings, "smooth_width": choice.width},
        stop_reason=f"{found.stop_reason}; {choice.reason}"
        if choice.reason
        else found.stop_reason,
    )
