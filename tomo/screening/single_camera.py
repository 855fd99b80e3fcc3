"""Which cameras stand out from the others, and their likeliest causes.

A volume is made from all views. Where one camera is wrong, its image fits that volume worst, and
without it the others fit theirs clearly better: leaving out any right camera changes little. The
camera that stands out is predicted from the others, and the candidate causes are compared on
that prediction. It is then set aside and the next one is looked for.

Some images are hard to predict though nothing is wrong: what they show is finer than voxels, or
comes from outside the grid. Exact cameras are therefore simulated, and a camera stands out only
where its image is clearly harder to predict than theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.screening.camera_causes import CAUSES
from tomo.screening.left_out_prediction import CommonVolume, PredictedViews
from tomo.screening.left_out_view import Explained
from tomo.selfcal.residual_shift import EXACT_MARGIN

FEWEST_VIEWS = 5
"""Views. Fewer predict each other too poorly to find a wrong one."""

SUSPECTS = 3
"""Views that fit worst, left out in turn: a wrong one makes its opposite fit badly too."""

SUSPICIOUS = 1.5
"""Times the median squared error of all views that a suspect's must be. Higher, small errors are
missed; lower, views are left out for nothing, which takes its time."""

NOISE_FLOOR = 0.1
"""Fraction of the noise's own mean square that every view's error counts at least: below it errors
are chance."""

STANDS_OUT = 5.0
"""Residual that leaves all views together with the camera, in those of an average other view, from
which a camera stands out. Right cameras make 1 to 8, those that are hard to predict most."""

APART = 1.6
"""Times the next suspect's that this residual must be."""

AGREE_BETTER = 0.97
"""Largest ratio of the others' squared error without the camera to that without the next suspect.
A right camera that is hard to predict does not make the others disagree."""

EXPLAINS = 0.5
"""Largest fraction of a camera's left-out error that a cause may leave: more, and it explains
nothing."""

AS_GOOD = 2.0
"""Times the error of a rolled image up to which a camera's pose explains it as well."""

BEYOND_DOUBT = 4.0
"""Times `STANDS_OUT`, and times the next suspect's residual, from which a camera stands out though
nothing explains it: another flame, or another moment."""

TINY = 1e-300  # keeps ratios finite where images are explained exactly

DIM = 1e-3
"""Mean square of an image, in the median of all, below which it makes no volume: a camera that was
off proves everything empty."""

MOST_WRONG = 1 / 3
"""Fraction of the views. Where more seem wrong, none is named: the test cannot tell which are
right."""


@dataclass(frozen=True, eq=False)
class CameraFinding:
    """One camera that stands out.

    Attributes
    ----------
    view : int
        Its number.
    name : str
    error : float
        Its relative left-out error, beyond noise.
    others : float
        Median relative error of the right views.
    removed : float
        The other views' squared error without the camera, over that with it.
    causes : tuple of Explained
        The causes, the likeliest of each kind, in their order.
    given : float
        Its left-out squared error beyond noise, in the unit of the causes'.
    worst : float
        Largest relative error of the right views.
    left_out : float
        Relative left-out error of a right camera, the median one.
    """

    view: int
    name: str
    error: float
    others: float
    removed: float
    causes: tuple[Explained, ...]
    given: float
    worst: float
    left_out: float

    def left(self, cause: Explained) -> float:
        """Return the fraction of the squared left-out error that a cause leaves."""
        return max(cause.excess, 0.0) / self.given if self.given > 0 else 1.0

    def names(self, cause: str) -> bool:
        """Return whether a cause is the likeliest, and explains the image."""
        return not self.unexplained and self.causes[0].cause == cause

    @property
    def unexplained(self) -> bool:
        """Whether no cause explains the image."""
        return not self.causes or self.left(self.causes[0]) > EXPLAINS

    def error_after(self, cause: Explained) -> float:
        """Return the relative left-out error with a cause corrected."""
        return self.error * float(np.sqrt(self.left(cause)))


@dataclass(frozen=True, eq=False)
class _Trial:
    """Views left out: the volume without them, and the residual that went away with them."""

    views: tuple[int, ...]
    volume: CommonVolume
    gone: float
    removed: float


def cameras_that_stand_out(views: PredictedViews, trusted: int) -> list[CameraFinding]:
    """Return a finding for each camera that stands out, the worst first.

    Parameters
    ----------
    views : PredictedViews
    trusted : int
        Only the first so many views make volumes; the others are compared with them.
    """
    dim = views.own_light < DIM * np.median(views.own_light)
    good = [view for view in range(trusted) if views.sees(view) and not dim[view]]
    most = int(MOST_WRONG * len(good))
    wrong: list[int] = []
    if len(good) < FEWEST_VIEWS:
        return []
    base = views.volume(good)
    while len(good) >= FEWEST_VIEWS:
        found = _standing_out(views, base, good)
        if found is None:
            break
        if len(wrong) + len(found.views) > most:
            break
        wrong += found.views
        good = [view for view in good if view not in found.views]
        base = found.volume
    held_out = [v for v in range(len(dim)) if views.sees(v) and (v >= trusted or dim[v])]
    if not (wrong or held_out):
        return []
    errors = errors_of(views, base)
    typical = sorted(good, key=lambda view: errors[view])[len(good) // 2]
    without = views.volume([view for view in good if view != typical])
    left_out = float(errors_of(views, without)[typical])
    for view in held_out:
        trial = _Trial((view,), base, 0.0, 1.0)
        beyond = errors[view] > BEYOND_DOUBT * STANDS_OUT * left_out
        stands_out = beyond or (errors[view] > STANDS_OUT * left_out and _explained(views, trial))
        if stands_out and _beyond_exact(views, trial):
            wrong.append(view)
    return [_finding(views, view, base, good, float(np.sqrt(left_out))) for view in wrong]


def errors_of(views: PredictedViews, volume: CommonVolume) -> NDArray[np.float64]:
    """Return the relative squared error of every view, not below a fraction of its noise."""
    return np.maximum(np.nan_to_num(volume.errors), 0) + NOISE_FLOOR * views.noise_level


def _standing_out(views: PredictedViews, base: CommonVolume, good: Sequence[int]) -> _Trial | None:
    """Return the trial of the camera that stands out, or of two, or None."""
    errors = errors_of(views, base)
    order = sorted(good, key=lambda view: -errors[view])[:SUSPECTS]
    limit = SUSPICIOUS * np.median(errors[list(good)])
    trials = [_trial(views, base, good, (v,)) for v in order if errors[v] > limit]
    if sum(sorted(trial.gone for trial in trials)[-2:]) < STANDS_OUT:
        return None
    known = {trial.views[0] for trial in trials}
    trials += [_trial(views, base, good, (v,)) for v in order if v not in known]
    first, second, third = sorted(trials, key=lambda trial: -trial.gone)
    if first.gone > STANDS_OUT and _apart(first, second):
        doubtless = first.gone > BEYOND_DOUBT * max(STANDS_OUT, second.gone)
        if (doubtless or _explained(views, first)) and _beyond_exact(views, first):
            return first
    if len(good) - 2 < FEWEST_VIEWS - 1 or not _apart(second, third):
        return None
    pair = _trial(views, base, good, first.views + second.views)
    enough = pair.gone > 2 * STANDS_OUT and _apart(pair, third)
    return pair if enough and _explained(views, pair) and _beyond_exact(views, pair) else None


def _apart(first: _Trial, second: _Trial) -> bool:
    """Return whether what a trial removes is far more than what the next one does."""
    better = first.removed < AGREE_BETTER * second.removed
    return better and first.gone > APART * second.gone


def _explained(views: PredictedViews, trial: _Trial) -> bool:
    """Return whether causes explain all views of a trial."""
    found = (_likeliest(views, view, trial.volume) for view in trial.views)
    return all(ranked and ranked[0].excess < EXPLAINS * given for ranked, given in found)


def _beyond_exact(views: PredictedViews, trial: _Trial) -> bool:
    """Return whether all views of a trial are harder to predict than from exact cameras."""
    kept = trial.volume.views
    exact = views.of_exact_cameras(kept)
    left_out, usual = list(trial.views), errors_of(exact, exact.volume(kept))
    found = errors_of(views, trial.volume)[left_out] > EXACT_MARGIN**2 * usual[left_out]
    return bool(found.all())


def _trial(
    views: PredictedViews, base: CommonVolume, good: Sequence[int], left_out: tuple[int, ...]
) -> _Trial:
    kept = [other for other in good if other not in left_out]
    volume = views.volume(kept)
    before, after = errors_of(views, base), errors_of(views, volume)
    gone = (before[list(good)].sum() - after[kept].sum()) / max(after[kept].mean(), TINY)
    removed = after[kept].sum() / max(before[kept].sum(), TINY)
    return _Trial(left_out, volume, float(gone), float(removed))


def _likeliest(
    views: PredictedViews, view: int, volume: CommonVolume
) -> tuple[list[Explained], float]:
    """Return the causes, the likeliest first, and the left-out error without any."""
    shown = views.left_out(view, volume)
    given = shown.excess(shown.predicted)
    if not given > 0:
        return [], 0.0
    found = [one for cause in CAUSES if (one := cause.fit(shown)) is not None]
    return sorted(found, key=lambda one: max(one.excess, 0.0) * one.penalty), given


def _finding(
    views: PredictedViews,
    view: int,
    base: CommonVolume,
    good: Sequence[int],
    left_out: float,
) -> CameraFinding:
    errors = errors_of(views, base)
    ranked, given = _likeliest(views, view, base)
    usual = given * min(left_out**2 / errors[view], 1.0)  # error of a right camera's prediction
    ranked.sort(key=lambda one: (max(one.excess, 0.0) + usual) * one.penalty)
    kinds: dict[str, Explained] = {}
    for one in ranked:
        kinds.setdefault(one.cause, one)
    posed = [one for one in ranked if one.cause == "pointing" and one.pose is not None]
    if posed and kinds["pointing"].pose is None:  # a roll: a pose explains it too
        same = posed[0].excess < AS_GOOD * max(kinds["pointing"].excess, usual)
        kinds["pointing"] = replace(kinds["pointing"], pose=posed[0].pose if same else None)
    again = views.volume([*good, view])
    removed = errors[list(good)].sum() / max(errors_of(views, again)[list(good)].sum(), TINY)
    return CameraFinding(
        view,
        views.coarse.rig.names[view],
        float(np.sqrt(errors[view])),
        float(np.sqrt(np.median(errors[list(good)]))),
        float(removed),
        tuple(kinds.values()),
        given,
        float(np.sqrt(errors[list(good)].max())),
        left_out,
    )
