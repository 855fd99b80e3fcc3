"""Which method, how smooth, how many iterations: chosen by predicting views left out.

A falling training residual does not say that the volume gets better: with few views, noise or
imperfect cameras it gets worse long before. What a reconstruction is worth shows in the views that
it did not use, so every candidate is run without some of the views and judged on those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import solvers
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.selection.candidates import Candidate, Candidates, Told, further_settings
from tomo.selection.cross_validation import FEW_VIEWS, MULTIPLICATIVE
from tomo.selection.rules import WIDTHS, of_few_views, of_many_views
from tomo.solvers import Solution
from tomo.solvers.initial_volume import common_start
from tomo.solvers.iterate import check_measured
from tomo.solvers.solution import Callback

FALLBACK = ("mlem", 1.0, 10)
"""With one or two views nothing can be left out: the method, width and iterations used then."""


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
    strength : float, optional
        Of the penalty; None is as faint as suits the unknowns (`ProjectionOperator.faint`).
    reason : str
        In words.
    tried : tuple of (method, width, iterations, held-out residual, strength)
        The best of each candidate.
    """

    method: str
    width: float
    iterations: int
    held_out_residual: float
    strength: float | None = None
    reason: str = ""
    tried: tuple[Candidate, ...] = ()

    @property
    def candidate(self) -> Candidate:
        """What was chosen, without why."""
        return Candidate(
            self.method, self.width, self.iterations, self.held_out_residual, self.strength
        )

    def solves_as(self, other: Choice) -> bool:
        """Return whether both solve the same way, however well that predicts left-out views."""
        ours, theirs = (one.candidate._replace(held_out_residual=0.0) for one in (self, other))
        return ours == theirs


def choose_by_held_out_views(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    weights: NDArray[np.float32] | None = None,
    progress: Told | None = None,
) -> Choice:
    """Choose method, smoothness and stop by the residual of views left out.

    Least squares are tried on plain voxels and then smoother, as long as that helps; the number of
    iterations comes with each. With noise or imperfect cameras a smooth basis predicts left-out
    views better; with clean images it does not. They are then given a faint penalty on differences
    of neighbours, unless the left-out views speak clearly against it and rays leave no gaps, and a
    narrower basis where that predicts clearly better with the penalty. Unknowns that have no edges
    (`ProjectionOperator.edged`) have a penalty on curvature instead of any width, stronger and
    stronger as long as that helps, of up to 18 noisy views a little stronger still, and are
    iterated on as long as left-out views gain: nothing is made up for by contrast there.

    With few views least squares have the penalty throughout, MLEM is tried likewise, and pixels
    of the other views, where there are enough, are left out as well. Those tell noise, by which
    smoothness and stop are chosen with them; the views tell the method.

    Parameters
    ----------
    projector : ProjectionOperator
        With its views; only those take part.
    measured : (pixels,)
    weights : (pixels,), optional
        What pixels are worth to least squares, and where they are judged: such as the inverse
        variances of their noise. All alike when None.
    progress : callable, optional
        ``progress(done, total, where)``.
    """
    measured = check_measured(projector, measured)
    views = np.flatnonzero(np.diff(projector.view_ptr)).tolist()
    if len(views) < 3 or not measured.any():
        reason = "too few views to leave any out" if measured.any() else "the images are dark"
        return Choice(*FALLBACK, math.nan, reason=reason)
    few = len(views) <= FEW_VIEWS
    total = 2 * len(WIDTHS) if few else len(WIDTHS) + 3
    candidates = Candidates.of(projector, measured, views, total, progress, weights)
    best = of_few_views(candidates) if few else of_many_views(candidates, projector)
    if progress:
        progress(total, total, "")
    chosen = candidates.candidate(best)
    residual = chosen.held_out_residual
    least = min(tried.held_out_residual for tried in candidates.tried)
    reason = f"left-out views are predicted best so (relative residual {residual:.4f})"
    if least < residual:
        reason = (
            "left-out views are predicted nearly best so, by a tamer volume (relative residual "
            f"{residual:.4f}, the best {least:.4f})"
        )
    return Choice(*chosen, reason=reason, tried=tuple(candidates.tried))


def residual_of_left_out_views(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    weights: NDArray[np.float32] | None = None,
) -> float:
    """Return the relative residual of views left out when it is done as ``choice`` says.

    Of the views that `choose_by_held_out_views` leaves out; NaN where it could leave out none.
    """
    measured = check_measured(projector, measured)
    if math.isnan(choice.held_out_residual):
        return math.nan
    views = np.flatnonzero(np.diff(projector.view_ptr)).tolist()
    candidates, squared = Candidates.of(projector, measured, views, weights=weights), 0.0
    for trial in candidates.trials:
        found = solve_as_chosen(
            trial.training, trial.training_pixels, choice, weights=trial.training_weights
        )
        squared += float(trial.squared_error(projector.active.compress(found.volume))[0])
    return candidates.residual(squared)


def solve_as_chosen(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    weights: NDArray[np.float32] | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Run what was chosen on all views, with the ``weights`` that it was chosen with.

    ``callback`` receives the volume itself, not the coefficients of the smooth basis.
    """
    run = getattr(solvers, choice.method)
    basis = GaussianBasis(projector, choice.width) if choice.width else None

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
        **further_settings(choice.method, projector, choice.strength, weights),
    )
    return replace(
        found,
        volume=basis.volume(found.volume) if basis else found.volume,
        settings={**found.settings, "smooth_width": choice.width},
        stop_reason=f"{found.stop_reason}; {choice.reason}"
        if choice.reason
        else found.stop_reason,
    )
