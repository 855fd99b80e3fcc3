"""Curvature: least squares with a prior on curvature, relative to the brightness."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import chosen, host, namespace
from tomo.losses import LeastSquares, check_strength
from tomo.operators.operator import ProjectionOperator
from tomo.priors import Gradient, RelativeCurvature
from tomo.solvers.iterate import States, drive, shared_parameters
from tomo.solvers.projected_cg import descend
from tomo.solvers.solution import Callback, Solution

FIRST, FIRST_STRENGTH = 10, 0.1
"""Iterations that find the brightness, and the fraction of the strength that they have, on first
differences. Fewer or weaker ones take noise for brightness; these differences blur more."""


@shared_parameters
def curvature(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    strength: float = 1e-4,
    iterations: int = 40,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct a smooth volume: the prior counts curvature, more where it is dark.

    Parameters
    ----------
    {projector}
    {measured}
    strength : float
        ``s``, >= 0. About 1e-4 for clean images, 1e-3 for photon noise, 3e-3 for noise of a tenth
        of the brightest pixel.
    {iterations}
        Each takes one adjoint and one projection.
    {start}
        All iterations have the prior on curvature then.
    {nonnegative}
    {weights}
    {callback}

    Notes
    -----
    Minimises ``||W^½ (b - A x)||² + s m ||w D^T D x||²`` over ``x >= 0`` by
    `tomo.solvers.projected_cg`. ``D^T D`` takes second differences, which slopes do not have: a
    flame loses less than by `tomo.solvers.tikhonov`. The weights ``w``
    (`tomo.priors.RelativeCurvature`) are large where it is dark: little light has little
    structure. They come from the volume of the first ten iterations, which are those of
    `tomo.solvers.tikhonov`, or from ``start``; ``m`` is the largest element of ``A^T W A 1``.
    """
    active, reduced = projector.active, FIRST_STRENGTH * check_strength(strength)
    first = LeastSquares(projector, measured, weights, Gradient(active), reduced)

    def states() -> States:
        volume = None
        if start is None:
            updates = descend(first, None, nonnegative)
            for volume, misfit in itertools.islice(updates, FIRST + 1):
                yield volume, misfit
        known = first.unit * first.start(start, nonnegative) if volume is None else volume
        problem = first.with_prior(RelativeCurvature(active, known), strength)
        updates = descend(problem, known, nonnegative)
        yield from updates if volume is None else itertools.islice(updates, 1, None)

    settings = {
        "method": "curvature",
        "strength": strength,
        "nonnegative": nonnegative,
        "weighted": weights is not None,
    }
    return drive(states(), projector, first.measured, iterations, callback, settings)


def curvature_of_several(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    strength: float,
    iterations: int,
    start: NDArray[np.float32],
    weights: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return the volumes of `curvature` up to rounding, as `tomo.solvers.mlem.mlem_of_several`.

    A column that overflows single precision keeps the volume of the update before, as in
    `tomo.solvers.iterate.drive`.
    """
    problem = LeastSquares(projector, measured, weights)
    known = problem.unit * problem.start(start, nonnegative=True)
    problem = problem.with_prior(RelativeCurvature(projector.active, known), strength)
    volumes = known
    xp = namespace(known)
    with projector.computing(), np.errstate(over="ignore", invalid="ignore"):
        for state, misfit in itertools.islice(descend(problem, known, True), iterations + 1):
            finite = host(xp.all(xp.isfinite(state), axis=0)) & np.isfinite(misfit)
            volumes = state if finite.all() else chosen(finite, state, volumes)
    return volumes
