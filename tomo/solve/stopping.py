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

from tomo import solve
from tomo.reconstruction import Callback, Reconstruction
from tomo.smooth_basis import SmoothBasis
from tomo.solve._candidates import Attempt, Candidate, Candidates, Told, further_settings
from tomo.solve._common_start import common_start
from tomo.solve._drive import check_measured
from tomo.solve._trials import FEW_VIEWS, MULTIPLICATIVE
from tomo.viewed import ViewedOperator

WORTH_ITS_DETAIL = 0.7
"""The penalty is left out where without it the left-out views' squared error is below this share.
Boxes alone predict clean images a little better and are further from the truth: they make up for
their width by contrast. Where the light itself is as rough as boxes they predict far better: of
some twenty such scenes eight made 0.28 to 0.55, others 0.75 or more. Flames have made 0.72."""

IN_GAPS = 0.01
"""With this share of voxels in gaps between rays the penalty stays. Left-out views do not see them
either, and rays so far apart leave much open of what they do see: a jet seen by a level ring of
cameras, with pixels of a voxel and a half, was half as far again from the truth without it, though
left-out views were predicted to 0.4 of their squared error."""

DETAILED = 0.92
NEARLY_AS_GOOD = 1.25
WORTH_NARROWING = 0.94
LONGER = 1.5
"""Of unknowns with edges. Widths are chosen without the penalty, which makes up for some of what a
wider basis is taken for. Where images are so detailed that without it left-out views have this
share of their squared error with it, and the next narrower basis is nearly as good, both are run
with it for so many times the iterations chosen: stopped early a wide basis is the more behind,
whatever the images. The narrower one must come down to this share of the wider one's squared
error. A turbulent flame in clean, fine images makes 0.86 of detail, 1.21 of the narrower basis,
and 0.89 with the penalty, and the narrower volume is a quarter nearer to the truth. Where it is
not, noisy images make 0.95 or more of detail, clean ones of pixels as large as voxels 0.91 or
more, and with the penalty both make 0.99 or more."""

TAMER = 0.94
"""With few views MLEM is taken unless least squares predict left-out views, beyond the noise, to
this share of its residual: it fills what the views leave open with what all of them allow, and
leaves dark what is dark. With more views least squares have been the better ones throughout."""

STRENGTHS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Of the penalty on curvature tried where unknowns have no edges. From 3e-5 on clean flames are as
near on average, jets by 6 % further and turbulent ones by 6 % nearer, in a quarter more time."""

WIDTHS = (0.0, 0.5, 0.8, 1.2, 1.8, 2.7)
"""Standard deviations of the smooth basis tried, in voxels. With few views, which seldom resolve
single voxels, none comes last, unless there are too few pixels to leave any out."""

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
        Of the penalty; None is as faint as suits the unknowns (`ViewedOperator.faint`).
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
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    weights: NDArray[np.float32] | None = None,
    progress: Told | None = None,
) -> Choice:
    """Choose method, smoothness and stop by the residual of views left out.

    Least squares are tried on plain voxels and then smoother, as long as that helps; the number of
    iterations comes with each. With noise or imperfect cameras a smooth basis predicts left-out
    views better; with clean images it does not. They are then given a faint penalty on
    differences of neighbours, unless the left-out views speak clearly against it and rays leave
    no gaps, and a narrower basis where that predicts clearly better with the penalty. Unknowns
    that have no edges (`ViewedOperator.edged`) have a penalty on curvature instead of any width,
    stronger and stronger as long as that helps, and are iterated on as long as left-out views
    gain: nothing is made up for by contrast there.

    With few views least squares have the penalty throughout, MLEM is tried likewise, and pixels
    of the other views, where there are enough, are left out as well. Those tell noise, by which
    smoothness and stop are chosen with them; the views tell the method.

    Parameters
    ----------
    projector : ViewedOperator
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
    best = _of_few_views(candidates) if few else _of_many_views(candidates, projector)
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


def _share_in_gaps(projector: ViewedOperator) -> float:
    """Return the share of voxels that no ray crosses though rays cross others on both sides.

    Corners of the grid that no camera sees are no gaps.
    """
    live, crossed = projector.live, projector.column_sums > 0
    seen, unseen = (live.expand(some).reshape(live.grid.shape) for some in (crossed, ~crossed))
    between = np.zeros_like(seen)
    for axis in range(3):
        before = np.logical_or.accumulate(seen, axis)
        behind = np.flip(np.logical_or.accumulate(np.flip(seen, axis), axis), axis)
        between |= before & behind
    return np.count_nonzero(between & unseen) / max(len(crossed), 1)


def _of_many_views(candidates: Candidates, projector: ViewedOperator) -> Attempt:
    """Return the best of least squares; ``projector`` is that of all views."""
    if not projector.edged:  # nothing that a penalty, or a width, would make up for in part
        return candidates.smoothed("curvature", strengths=STRENGTHS)[-1]
    helped = candidates.smoothed("nnls", WIDTHS)
    plain = helped[-1]
    # Iterations stay: the penalty is to make a volume tamer, not to go on for longer.
    penalised = candidates.attempt("tikhonov", plain.width, iterations=plain.iterations)
    clearly = plain.error < WORTH_ITS_DETAIL * penalised.error
    if clearly and _share_in_gaps(projector) < IN_GAPS:  # in this order: gaps take a product
        return plain
    penalised = replace(penalised, iterations=plain.iterations)
    candidates.tried[-1] = candidates.candidate(penalised)
    coarse = plain.error > DETAILED * penalised.error
    if coarse or len(helped) == 1 or helped[-2].error > NEARLY_AS_GOOD * plain.error:
        return penalised
    longer = {"iterations": round(LONGER * plain.iterations), "to_the_end": True}
    wide = candidates.attempt("tikhonov", plain.width, **longer)
    needed = [WORTH_NARROWING * each for each in wide.of_trials]
    narrow = candidates.attempt("tikhonov", helped[-2].width, needed, **longer)
    return narrow if narrow.error < sum(needed) else penalised


def _of_few_views(candidates: Candidates) -> Attempt:
    """Return the better of least squares and MLEM, whose iterations are the quicker ones."""
    if not candidates.spare:
        return _better(*(candidates.smoothed(each, WIDTHS)[-1] for each in ("mlem", "tikhonov")))
    mlem = _of_some_width(candidates, "mlem")
    return _better(mlem, _of_some_width(candidates, "tikhonov", mlem))


def _better(mlem: Attempt, least_squares: Attempt) -> Attempt:
    """Return least squares where they predict left-out views clearly better, beyond the noise."""
    noise = min(min(each.spared, each.of_views) for each in (least_squares, mlem))
    if least_squares.of_views - noise > TAMER**2 * (mlem.of_views - noise):
        return mlem
    return least_squares


def _of_some_width(candidates: Candidates, method: str, rival: Attempt | None = None) -> Attempt:
    """Return the best of a method, on plain voxels only where wider and wider does not help."""
    helped = candidates.smoothed(method, WIDTHS[1:], rival)
    if len(helped) > 1:
        return helped[-1]
    plain = candidates.attempt(method, 0.0, helped[0].or_better(rival))
    return plain if plain.error < helped[0].error else helped[0]


def residual_of_left_out_views(
    projector: ViewedOperator,
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
        squared += float(trial.squared_error(projector.live.compress(found.volume))[0])
    return candidates.residual(squared)


def solve_as_chosen(
    projector: ViewedOperator,
    measured: ArrayLike,
    choice: Choice,
    *,
    weights: NDArray[np.float32] | None = None,
    callback: Callback | None = None,
) -> Reconstruction:
    """Run what was chosen on all views, with the ``weights`` that it was chosen with.

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
