"""CGLS: conjugate gradients for least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo.reconstruction import Callback, Reconstruction
from tomo.solve._drive import (
    States,
    additive_start,
    check_measured,
    drive,
    norm,
    unit_of,
)
from tomo.viewed import ViewedOperator

SINGLE_PRECISION = float(np.finfo(np.float32).eps)


def cgls(
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    callback: Callback | None = None,
) -> Reconstruction:
    """Minimise ``||b - A x||`` by conjugate gradients on ``A^T A x = A^T b``.

    The fastest of the classic methods on clean images; on noisy ones it must be stopped early.
    The recurrence knows no bounds: with ``nonnegative`` each volume reported and returned is
    ``max(x, 0)``, while the iteration goes on from the unclipped ``x``. Its history holds the
    residual of the unclipped ``x``, which the recurrence gives for nothing.

    Parameters
    ----------
    projector : ViewedOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Zeros when None.
    nonnegative : bool
        Whether negative voxels are set to zero in what is reported.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of
    Research of the National Bureau of Standards 49 (1952), section 10; Björck, "Numerical
    Methods for Least Squares Problems" (1996), algorithm 7.4.1.
    """
    measured = check_measured(projector, measured)

    def states() -> States:
        unit = unit_of(measured)
        x = additive_start(projector, start, nonnegative=False) / unit
        residual = measured / unit - projector @ x
        gradient = projector.T @ residual
        direction = gradient
        gamma = gamma_start = norm(gradient) ** 2
        while True:
            yield unit * (np.maximum(x, 0) if nonnegative else x), float(unit) * norm(residual)
            image = projector @ direction
            curvature = norm(image) ** 2
            # At the limit of single precision there is no direction left to go.
            if curvature == 0 or gamma <= gamma_start * SINGLE_PRECISION**2:
                return
            step = np.float32(gamma / curvature)
            x = x + step * direction
            residual = residual - step * image
            gradient = projector.T @ residual
            gamma, previous = norm(gradient) ** 2, gamma
            direction = gradient + np.float32(gamma / previous) * direction

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "cgls", "nonnegative": nonnegative},
    )
