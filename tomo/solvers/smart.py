"""SMART: the simultaneous multiplicative algebraic reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import as_type, like, namespace
from tomo._compute.reductions import norm
from tomo.losses import ratio, sensitivity
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured, multiplicative_start
from tomo.solvers.iterate import (
    States,
    check_nonnegative,
    check_relaxation,
    drive,
    shared_parameters,
)
from tomo.solvers.solution import Callback, Solution

FAINTEST = 1e-3
"""Fraction of its projection that a pixel counts as at least. At zero, a dark pixel would empty
all voxels that it sees; at one, it would empty none."""


@shared_parameters
def smart(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 50,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    relaxation: float = 1.0,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct by simultaneous multiplicative updates: MART with all rays at once.

    Every voxel moves by the weighted geometric mean of its rays' ratios, MLEM's by the arithmetic
    one: it is slower to fill voxels that one ray wants filled, and faster to empty them. Pixels at
    or below zero count as a thousandth of their projection, so that one of them does not empty all
    voxels that it sees, as in MART.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
    {positive_start}
    {always_nonnegative}
    {relaxation}
        It converges at 1.
    {callback}

    Notes
    -----
    ``x <- x exp(r / (A^T 1) * A^T log(b / A x))`` minimises the cross entropy ``KL(A x, b)``,
    where MLEM minimises ``KL(b, A x)``. Among all volumes that reproduce the images it tends to
    the one nearest to the start, in entropy.

    References
    ----------
    Byrne, "Iterative image reconstruction algorithms based on cross-entropy minimization", IEEE
    Transactions on Image Processing 2 (1993), equation 1.8; in tomographic velocimetry, Atkinson
    and Soria, Experiments in Fluids 47 (2009).
    """
    check_nonnegative("smart", nonnegative)
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    xp = namespace(measured)
    counts = xp.maximum(measured, 0.0)
    per_column = like(sensitivity(projector.column_sums)[0], measured)

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            projected = projector @ x
            yield x, norm(measured - projected)
            rise = projector.T @ _log_ratio(counts, projected)
            x = as_type(x * xp.exp(relaxation * per_column * rise), np.float32)

    settings = {"method": "smart", "nonnegative": True, "relaxation": relaxation}
    return drive(states(), projector, measured, iterations, callback, settings)


def _log_ratio(counts: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return ``log(b / A x)``, at least that of `FAINTEST`; 0 where nothing is projected."""
    xp = namespace(counts)
    return xp.log(xp.maximum(ratio(counts, projected), FAINTEST))
