"""SMART: the simultaneous multiplicative algebraic reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.iterate import (
    States,
    check_measured,
    check_relaxation,
    drive,
    multiplicative_start,
)
from tomo.solvers.mlem import check_nonnegative, ratio, sensitivity
from tomo.solvers.solution import Callback, Solution

FAINTEST = 1e-3
"""Share of what is projected that a pixel counts as at least: the logarithm of zero is not."""


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
    """Solve by SMART: ``x <- x exp(r / (A^T 1) * A^T log(b / A x))``.

    It descends the cross entropy ``KL(A x, b)``, where MLEM descends ``KL(b, A x)``: of all
    volumes that reproduce the images it tends to that nearest to the start, in entropy. Every
    voxel moves by the weighted geometric mean of its rays' ratios, MLEM's by the arithmetic one:
    it is slower to fill what one ray wants filled, and faster to empty. Pixels at or below zero
    count as a thousandth of what is projected, so that one of them does not empty all that it
    sees, as in MART.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Must not be negative; a constant when None.
    nonnegative : bool
        Must be True: the method has no other form.
    relaxation : float
        ``r``, below 2; converges at 1.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    Byrne, "Iterative image reconstruction algorithms based on cross-entropy minimization", IEEE
    Transactions on Image Processing 2 (1993), equation 1.8; in tomographic velocimetry, Atkinson
    and Soria, Experiments in Fluids 47 (2009).
    """
    check_nonnegative("smart", nonnegative)
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    counts = np.maximum(measured, 0)
    per_column, _ = sensitivity(projector.column_sums)

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            projected = projector @ x
            yield x, norm(measured - projected)
            rise = projector.T @ _log_ratio(counts, projected)
            x = (x * np.exp(relaxation * per_column * rise)).astype(np.float32)

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "smart", "nonnegative": True, "relaxation": relaxation},
    )


def _log_ratio(counts: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return ``log(b / A x)``, at least that of `FAINTEST`; 0 where nothing is projected."""
    return np.log(np.maximum(ratio(counts, projected), FAINTEST))
