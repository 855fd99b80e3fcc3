"""Candidates: methods, basis widths and prior strengths, compared on left-out data."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.operators import LINEAR, VOXEL, ProjectionOperator
from tomo.selection.cross_validation import (
    CHECKPOINTS,
    FEW_VIEWS,
    MULTIPLICATIVE,
    Fold,
    views_to_leave_out,
    weighed,
)
from tomo.solvers.curvature import FIRST
from tomo.solvers.subsets import interleaved

ITERATIONS = {"mlem": 17, "nnls": 40, "tikhonov": 40, "curvature": 40}
"""Iterations at most: Poisson likelihood, least squares without and with a penalty."""

LONGEST = 80
"""Iterations at most of penalised least squares on a basis without edges."""

PENALISED = ("tikhonov", "curvature")
"""Methods with a prior strength."""

DEFAULT_STRENGTH = {VOXEL: 5e-4, LINEAR: 1e-4}
"""Prior strength, by basis, where none is chosen: a weaker one leaves the contrast that makes up
for the edges of voxels, a stronger one takes detail from clean images."""

WORTH_WIDENING = 0.1
"""A wider basis must gain at least this fraction of the gain so far: less is chance, and costs
detail. A stronger penalty loses less detail and only has to gain."""

SEGMENTS_A_FOLD = 2_500_000
PIXELS_AN_UNKNOWN = 8
"""Larger systems are thinned evenly to about so many segments. At least so many pixels an unknown
stay, where there are more: an underdetermined system would ask for too much smoothness."""


class Candidate(NamedTuple):
    """A method with its settings, and the relative residual of the left-out views.

    ``strength`` is the prior's; None is the basis' default strength, or no prior.
    """

    method: str
    width: float
    iterations: int
    held_out_residual: float
    strength: float | None = None


Progress = Callable[[int, int, str], None]
"""``progress(done, total, where)``."""


def further_settings(
    method: str,
    projector: ProjectionOperator,
    strength: float | None,
    weights: NDArray[np.float32] | None,
) -> Mapping[str, Any]:
    """Return a method's settings other than its iterations.

    ``weights`` are pixel weights for least squares; MLEM models photon noise itself.
    """
    found: dict[str, Any] = {} if method in MULTIPLICATIVE else {"weights": weights}
    if method in PENALISED:
        found["strength"] = DEFAULT_STRENGTH[projector.basis] if strength is None else strength
    return found


@dataclass(frozen=True)
class Fit:
    """A candidate's errors, stopped where it predicts the left-out data best.

    ``view_error`` and ``pixel_error`` are summed over the folds, see `Fold.squared_error`;
    ``fold_errors`` is the sum of both for each fold.
    """

    method: str
    width: float
    iterations: int
    view_error: float
    pixel_error: float
    fold_errors: Sequence[float]
    strength: float | None = None

    @property
    def error(self) -> float:
        """The sum of both, by which smoothness and stop are chosen."""
        return self.view_error + self.pixel_error

    def or_better(self, rival: Fit | None) -> Sequence[float]:
        """Return the errors of the folds, the rival's where they are lower."""
        if rival is None:
            return self.fold_errors
        return [min(each) for each in zip(self.fold_errors, rival.fold_errors, strict=True)]


@dataclass(eq=False)
class Candidates:
    """The folds that compare candidates, and the candidates tried so far.

    ``scale`` is the squared norm of the left-out views.
    """

    folds: Sequence[Fold]
    scale: float
    total: int = 0
    progress: Progress | None = None
    tried: list[Candidate] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        views: Sequence[int],
        total: int = 0,
        progress: Progress | None = None,
        weights: NDArray[np.float32] | None = None,
    ) -> Candidates:
        """Leave out views, and pixels of the others where views are few; thin large systems.

        ``weights`` are pixel weights, in training and evaluation.
        """
        stride = _stride(projector)
        if stride > 1:
            thinned = interleaved(projector.shape[0], stride)[0]
            projector, measured = projector.take(thinned), measured[thinned]
            weights = None if weights is None else weights[thinned]
        scatter = len(views) <= FEW_VIEWS
        folds = [
            Fold.leaving_out(
                left_out, views, projector, measured, scatter=scatter, weights=weights
            )
            for left_out in views_to_leave_out(views)
        ]
        dark = sum(float(fold.dark[0]) for fold in folds)
        scale = dark or norm(weighed(measured, weights)) ** 2
        return cls(folds, max(scale, np.finfo(float).tiny), total, progress)

    @property
    def leaves_out_pixels(self) -> bool:
        """Whether scattered pixels of the training views are left out as well."""
        return any(fold.scattered.any() for fold in self.folds)

    @property
    def weighted(self) -> bool:
        """Whether pixels have different weights."""
        return any(fold.training_weights is not None for fold in self.folds)

    def fit(
        self,
        method: str,
        width: float,
        best: Sequence[float] = (),
        *,
        strength: float | None = None,
        iterations: int | None = None,
        to_the_end: bool = False,
    ) -> Fit:
        """Run a candidate in every fold, and stop it where it predicts the left-out data best.

        ``best`` are another candidate's errors, one a fold; a run that cannot reach them ends
        early.
        """
        if self.progress:
            setting = f"smoothness {width:g}" if strength is None else f"strength {strength:g}"
            where = f"choosing: {method}, {setting}"
            self.progress(len(self.tried), self.total, where)
        training = self.folds[0].training
        patient = method in PENALISED and training.basis == LINEAR
        most = iterations or (LONGEST if patient else ITERATIONS[method])

        def settings(fold: Fold) -> Mapping[str, Any]:
            further = further_settings(method, training, strength, fold.training_weights)
            return {"iterations": most, **further}

        evaluation = {
            "after": FIRST if method == "curvature" else 0,
            "patient": patient,
            "to_the_end": to_the_end,
        }
        errors = np.array(  # (folds, checkpoints, 2)
            [
                fold.squared_errors(method, width, settings(fold), rival, **evaluation)
                for fold, rival in zip(self.folds, best or [0.0] * len(self.folds), strict=True)
            ]
        )
        together = errors.sum(axis=0)
        stop = int(np.argmin(together.sum(axis=1)))
        view_error, pixel_error = together[stop].tolist()
        fold_errors = errors[:, stop].sum(axis=1).tolist()
        stopped = CHECKPOINTS[stop]
        found = Fit(method, width, stopped, view_error, pixel_error, fold_errors, strength)
        self.tried.append(self.candidate(found))
        return found

    def smoothed(
        self,
        method: str,
        widths: Sequence[float] = (0.0,),
        rival: Fit | None = None,
        *,
        strengths: Sequence[float | None] = (None,),
    ) -> list[Fit]:
        """Try wider bases, or stronger penalties, while they improve; return those, best last.

        A run that cannot reach ``rival``, another method's best, ends early.
        """
        (width, strength), *smoother = itertools.product(widths, strengths)
        reached = rival.fold_errors if rival else ()
        improved = [self.fit(method, width, reached, strength=strength)]
        for width, strength in smoother:
            plain, best = improved[0], improved[-1]
            found = self.fit(method, width, best.or_better(rival), strength=strength)
            worth = 0.0 if width == best.width else WORTH_WIDENING
            if best.error - found.error <= worth * (plain.error - best.error):
                break
            improved.append(found)
        return improved

    def candidate(self, found: Fit) -> Candidate:
        """Return a fit as a `Candidate`."""
        residual = self.residual(found.view_error)
        return Candidate(found.method, found.width, found.iterations, residual, found.strength)

    def residual(self, squared: float) -> float:
        """Return the relative residual of the left-out views."""
        return math.sqrt(squared / self.scale)


def _stride(projector: ProjectionOperator) -> int:
    """Return the stride by which pixels are thinned."""
    pixels, unknowns = projector.shape
    wanted = math.ceil(projector.n_segments / SEGMENTS_A_FOLD)
    if pixels > unknowns:
        wanted = min(wanted, pixels // (PIXELS_AN_UNKNOWN * max(unknowns, 1)))
    return max(wanted, 1)
