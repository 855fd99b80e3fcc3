"""The rules by which a candidate is selected, for many views and for few."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tomo.operators import LINEAR, ProjectionOperator
from tomo.selection.candidates import Candidate, Candidates, Fit

UNPENALISED_MARGIN = 0.7
"""The penalty is dropped where the fit without it has less than this fraction of the penalised
fit's squared validation error. Higher: voxels sharpen clean images and move off the truth. Lower:
emission as rough as voxels is smoothed away."""

MOST_GAPS = 0.01
"""Fraction of voxels in gaps between rays above which the penalty stays: left-out views see these
gaps as little as the others do."""

DETAILED = 0.92
NEARLY_AS_GOOD = 1.25
WORTH_NARROWING = 0.94
LONGER = 1.5
"""If the unpenalised fit has less than `DETAILED` times the penalised fit's validation error, and
the next narrower basis is within `NEARLY_AS_GOOD`, both are refitted with the penalty for `LONGER`
times as many iterations. The narrower one is taken if its error is below `WORTH_NARROWING` times
the wider one's."""

MLEM_MARGIN = 0.94
"""With few views MLEM is taken unless least squares have less than this fraction of its validation
residual, beyond the noise: MLEM keeps dark regions dark where views leave them undetermined."""

STRENGTHS = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2)
"""Strengths of the curvature penalty that are tried on a basis without edges."""

SEVERAL_VIEWS, STRONGER = 18, 10**0.25
"""Up to so many views of noisy images, the penalty is this much stronger than the best predictor:
noise in what few views leave undetermined shows in the volume more than in any view."""

WIDTHS = (0.0, 0.5, 0.8, 1.2, 1.8, 2.7)
"""Standard deviations of the Gaussian basis that are tried, in voxels. With few views, which
seldom resolve single voxels, 0 is tried last."""


def of_many_views(candidates: Candidates, projector: ProjectionOperator) -> Fit:
    """Return the best least-squares fit; ``projector`` has all views."""
    if projector.basis == LINEAR:  # smoothness is set by the penalty alone
        predicts = candidates.smoothed("curvature", strengths=STRENGTHS)[-1]
        several = np.count_nonzero(np.diff(projector.view_ptr)) <= SEVERAL_VIEWS
        clean = predicts.strength == STRENGTHS[0] and not candidates.weighted
        if clean or not several:
            return predicts
        strength = STRONGER * _best_strength(candidates.tried)
        return candidates.fit("curvature", 0.0, strength=strength)
    improved = candidates.smoothed("nnls", WIDTHS)
    plain = improved[-1]
    # The same iterations: the penalty is to smooth, not to iterate for longer.
    penalised = candidates.fit("tikhonov", plain.width, iterations=plain.iterations)
    clearly = plain.error < UNPENALISED_MARGIN * penalised.error
    if (
        clearly and _fraction_in_gaps(projector) < MOST_GAPS
    ):  # in this order: gaps cost a projection
        return plain
    penalised = replace(penalised, iterations=plain.iterations)
    candidates.tried[-1] = candidates.candidate(penalised)
    coarse = plain.error > DETAILED * penalised.error
    if coarse or len(improved) == 1 or improved[-2].error > NEARLY_AS_GOOD * plain.error:
        return penalised
    longer = {"iterations": round(LONGER * plain.iterations), "to_the_end": True}
    wide = candidates.fit("tikhonov", plain.width, **longer)
    needed = [WORTH_NARROWING * each for each in wide.fold_errors]
    narrow = candidates.fit("tikhonov", improved[-2].width, needed, **longer)
    return narrow if narrow.error < sum(needed) else penalised


def _best_strength(tried: Sequence[Candidate]) -> float:
    """Return the strength with the least validation error, interpolated.

    A parabola of the squared residual over the logarithm of the strength passes through the best
    and its two neighbours; the first or last strength is returned as it is.
    """
    squares = [each.held_out_residual**2 for each in tried]
    best = int(np.argmin(squares))
    if best in (0, len(tried) - 1):
        return tried[best].strength
    around = slice(best - 1, best + 2)
    logs = np.log([each.strength for each in tried[around]])
    square, slope, _ = np.polyfit(logs, squares[around], 2)
    return math.exp(-slope / (2 * square))


def of_few_views(candidates: Candidates) -> Fit:
    """Return the better of least squares and MLEM; MLEM, the faster, goes first."""
    if not candidates.leaves_out_pixels:
        return _better(*(candidates.smoothed(each, WIDTHS)[-1] for each in ("mlem", "tikhonov")))
    mlem = _of_some_width(candidates, "mlem")
    return _better(mlem, _of_some_width(candidates, "tikhonov", mlem))


def _better(mlem: Fit, least_squares: Fit) -> Fit:
    """Return least squares where they predict left-out views clearly better, beyond the noise."""
    noise = min(min(each.pixel_error, each.view_error) for each in (least_squares, mlem))
    if least_squares.view_error - noise > MLEM_MARGIN**2 * (mlem.view_error - noise):
        return mlem
    return least_squares


def _of_some_width(candidates: Candidates, method: str, rival: Fit | None = None) -> Fit:
    """Return a method's best fit; plain voxels are tried only where wider bases do not improve."""
    improved = candidates.smoothed(method, WIDTHS[1:], rival)
    if len(improved) > 1:
        return improved[-1]
    plain = candidates.fit(method, 0.0, improved[0].or_better(rival))
    return plain if plain.error < improved[0].error else improved[0]


def _fraction_in_gaps(projector: ProjectionOperator) -> float:
    """Return the fraction of voxels that no ray crosses, between voxels that rays do cross.

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
