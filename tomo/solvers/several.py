"""Several sets of images at once: each product with the matrix serves all of them.

Frames of a film, or repeats of one frame with other noise, meet the same matrix, whose entries
take most of a product's time to read. Their pixels are columns here; each has steps of its own,
and its volume is that of `tomo.solvers.mlem` or `tomo.solvers.curvature` up to rounding. Volumes
stay where products are computed.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, chosen, host, namespace
from tomo.losses import LeastSquares, Poisson
from tomo.operators.operator import ProjectionOperator
from tomo.priors import RelativeCurvature
from tomo.solvers.projected_cg import descend


def mlem_of_several(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    iterations: int,
    start: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the volumes of `tomo.solvers.mlem`, ``(unknowns, columns)``.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels, columns) float32
    iterations : int
    start : (unknowns, columns) float32
        Not negative.
    """
    loss = Poisson(projector, projector.array(measured), projector.column_sums)
    volumes = projector.array(start)
    for _ in range(iterations):
        with projector.computing():
            volumes = as_type(volumes * loss.factor(projector @ volumes), np.float32)
    return volumes


def curvature_of_several(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    strength: float,
    iterations: int,
    start: NDArray[np.float32],
    weights: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return the volumes of `tomo.solvers.curvature` from some starts, ``(unknowns, columns)``.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels, columns) float32
    strength : float
    iterations : int
    start : (unknowns, columns) float32
    weights : (pixels, columns) float32, optional

    Notes
    -----
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
