"""SIRT: simultaneous iterative reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.reconstruction import Callback, Reconstruction
from tomo.solve._drive import (
    States,
    additive_start,
    check_measured,
    check_relaxation,
    drive,
    norm,
)
from tomo.viewed import ViewedOperator


def reciprocal(sums: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return ``1 / sums`` with zero where a ray meets no voxel or a voxel no ray."""
    return np.divide(1.0, sums, out=np.zeros_like(sums), where=sums > 0).astype(np.float32)


def sirt(
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    iterations: int = 100,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    relaxation: float = 1.0,
    callback: Callback | None = None,
) -> Reconstruction:
    """Solve by SIRT: ``x <- x + r C A^T R (b - A x)``.

    ``R`` and ``C`` are the reciprocal row and column sums of A. It descends the weighted least
    squares ``(b - A x)^T R (b - A x)`` and converges for ``0 < r < 2``.

    Parameters
    ----------
    projector : ViewedOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Zeros when None.
    nonnegative : bool
        Whether the start and each update become ``max(x, 0)``.
    relaxation : float
        ``r``.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    Gregor and Benson, "Computational analysis and improvement of SIRT", IEEE Transactions on
    Medical Imaging 27 (2008), equation 4.
    """
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    per_row, per_column = reciprocal(projector.row_sums), reciprocal(projector.column_sums)

    def states() -> States:
        x = additive_start(projector, start, nonnegative)
        while True:
            residual = measured - projector @ x
            yield x, norm(residual)
            x = x + relaxation * per_column * (projector.T @ (per_row * residual))
            if nonnegative:
                x = np.maximum(x, 0)

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "sirt", "nonnegative": nonnegative, "relaxation": relaxation},
    )
