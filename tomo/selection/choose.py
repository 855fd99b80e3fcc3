"""Method, smoothness and iterations, chosen by predicting left-out views.

A falling training residual does not mean a better volume: with few views, noise or inexact cameras
the volume gets worse long before. Every candidate is therefore run without some of the views, and
compared by how well it predicts those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo import solvers
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured
from tomo.selection.candidates import Candidate, Candidates, Progress, further_settings
from tomo.selection.cross_validation import FEW_VIEWS, MULTIPLICATIVE
from tomo.selection.rules import WIDTHS, of_few_views, of_many_views
from tomo.solvers import Solution
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.solution import Callback

FALLBACK = ("mlem", 1.0, 10)
"""Method, width and iterations for one or two views, where none can be left out."""


@dataclass(frozen=True)
class Choice:
    """How to reconstruct, and why.

    Attributes
    ----------
    method : str
    width : float
        Standard deviation of the Gaussian basis, in voxels; 0 for none.
    iterations : int
    held_out_residual : float
        Relative residual of the left-out views (relative to all views if those are dark); NaN if
        none could be left out.
    strength : float, optional
        Prior strength; None is the default of the basis (`DEFAULT_STRENGTH`).
    reason : str
        Why, in words.
    tried : tuple of (method, width, iterations, held-out residual, strength)
        One line for each candidate, at its best iteration.
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
        """The choice without its reason."""
        return Candidate(
            self.method, self.width, self.iterations, self.held_out_residual, self.strength
        )

    def solves_as(self, other: Choice) -> bool:
        """Return whether both solve the same way, whatever their validation errors."""
        ours, theirs = (one.candidate._replace(held_out_residual=0.0) for one in (self, other))
        return ours == theirs


def choose_by_held_out_views(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    weights: NDArray[np.float32] | None = None,
    progress: Progress | None = None,
) -> Choice:
    """Choose method, smoothness and iterations by cross-validation over views.

    Least squares are tried on plain voxels and then on wider Gaussian bases while these improve;
    each fit also gives its number of iterations. With noise or inexact cameras a wide basis
    predicts left-out views better, with clean images it does not. The best fit then gets the
    default penalty on differences of neighbours, unless the left-out views clearly reject it and
    rays leave no gaps, and a narrower basis where that predicts clearly better. The linear basis,
    which has no edges, has a penalty on curvature instead of any width, increased while it
    improves, a little more for up to 18 noisy views, and is iterated while the prediction
    improves.

    With few views least squares have the penalty throughout and MLEM is tried too. Scattered
    pixels of the training views are left out as well, if there are enough: they show the noise
    and decide smoothness and iterations together with the views; the views decide the method.

    Parameters
    ----------
    projector : ProjectionOperator
        The operator of the views that take part.
    measured : (pixels,)
    weights : (pixels,), optional
        Pixel weights for least squares and for evaluation, such as inverse variances of the
        noise; all 1 when None.
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
    reason = f"it predicts left-out views best (relative residual {residual:.4f})"
    if least < residual:
        reason = (
            "it predicts left-out views nearly best, with a smoother volume (relative residual "
            f"{residual:.4f}, the best {least:.4f})"
        )
    return Choice(*chosen, reason=reason, tried=tuple(candidates.tried))


def residual_of_left_out_views(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    weights: NDArray[np.float32] | None = None,
) -> float:
    """Return the relative residual of left-out views for a given choice.

    The views are those that `choose_by_held_out_views` leaves out; NaN where it leaves out none.
    """
    measured = check_measured(projector, measured)
    if math.isnan(choice.held_out_residual):
        return math.nan
    views = np.flatnonzero(np.diff(projector.view_ptr)).tolist()
    candidates, squared = Candidates.of(projector, measured, views, weights=weights), 0.0
    for fold in candidates.folds:
        found = solve_as_chosen(
            fold.training, fold.training_pixels, choice, weights=fold.training_weights
        )
        squared += float(fold.squared_error(projector.active.compress(found.volume))[0])
    return candidates.residual(squared)


def solve_as_chosen(
    projector: ProjectionOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    weights: NDArray[np.float32] | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Run the chosen method on all views, with the ``weights`` that it was chosen with.

    ``callback`` receives the volume itself, not the coefficients of the smooth basis.
    """
    run = getattr(solvers, choice.method)
    basis = GaussianBasis(projector, choice.width) if choice.width else None

    def report(index: int, volume: NDArray[np.float32], residual: float) -> bool | None:
        return callback(index, basis.to_voxels(volume) if basis else volume, residual)

    start = None
    if choice.method in MULTIPLICATIVE:
        start = mlos_start(projector, check_measured(projector, measured))
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
