"""Which candidate is taken, of many views and of few: rules, each with what it rests on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tomo.operators.operator import ProjectionOperator
from tomo.selection.candidates import Attempt, Candidate, Candidates

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

SEVERAL_VIEWS, STRONGER = 18, 10**0.25
"""Up to so many views that penalty is so much stronger, by half a step of `STRENGTHS`, than where
left-out views are predicted best: noise in what the views leave open shows in the volume more than
in any view. Noisy flames of 9 to 17 views come 2 to 7 % nearer to the truth on average, some a
tenth further off; of 20 or more they are nearest where left-out views are predicted best. So are
clean ones: where the faintest is, and pixels are not weighed by their noise, it stays."""

WIDTHS = (0.0, 0.5, 0.8, 1.2, 1.8, 2.7)
"""Standard deviations of the smooth basis tried, in voxels. With few views, which seldom resolve
single voxels, none comes last, unless there are too few pixels to leave any out."""


def of_many_views(candidates: Candidates, projector: ProjectionOperator) -> Attempt:
    """Return the best of least squares; ``projector`` is that of all views."""
    if not projector.edged:  # nothing that a penalty, or a width, would make up for in part
        predicts = candidates.smoothed("curvature", strengths=STRENGTHS)[-1]
        several = np.count_nonzero(np.diff(projector.view_ptr)) <= SEVERAL_VIEWS
        clean = predicts.strength == STRENGTHS[0] and not candidates.weighted
        if clean or not several:
            return predicts
        strength = STRONGER * _predicting_best(candidates.tried)
        return candidates.attempt("curvature", 0.0, strength=strength)
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


def _predicting_best(tried: Sequence[Candidate]) -> float:
    """Return the strength that predicts left-out views best, by the best of them and those beside.

    By a parabola of the squared residual over the logarithm of the strength; where the best is the
    first or the last, that itself.
    """
    squares = [each.held_out_residual**2 for each in tried]
    best = int(np.argmin(squares))
    if best in (0, len(tried) - 1):
        return tried[best].strength
    around = slice(best - 1, best + 2)
    logs = np.log([each.strength for each in tried[around]])
    square, slope, _ = np.polyfit(logs, squares[around], 2)
    return math.exp(-slope / (2 * square))


def of_few_views(candidates: Candidates) -> Attempt:
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


def _share_in_gaps(projector: ProjectionOperator) -> float:
    """Return the share of voxels that no ray crosses though rays cross others on both sides.

    Corners of the grid that no camera sees are no gaps.
    """
    active, crossed = projector.active, projector.column_sums > 0
    seen, unseen = (active.expand(some).reshape(active.grid.shape) for some in (crossed, ~crossed))
    between = np.zeros_like(seen)
    for axis in range(3):
        before = np.logical_or.accumulate(seen, axis)
        behind = np.flip(np.logical_or.accumulate(np.flip(seen, axis), axis), axis)
        between |= before & behind
    return np.count_nonzero(between & unseen) / max(len(crossed), 1)
