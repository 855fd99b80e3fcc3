"""MLEM: maximum likelihood by expectation maximisation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.projector import Projector
from tomo.reconstruction import Reconstruction
from tomo.solve._drive import Callback, States, check_measured, drive, multiplicative_start, norm
from tomo.solve.sirt import reciprocal


def ratio(measured: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return ``measured / projected``, and 1 (no change) where nothing is projected."""
    return np.divide(measured, projected, out=np.ones_like(measured), where=projected > 0)


def mlem(
    projector: Projector,
    measured: ArrayLike,
    *,
    iterations: int = 50,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    callback: Callback | None = None,
) -> Reconstruction:
    """Solve by MLEM: ``x <- x / (A^T 1) * A^T (b / A x)``.

    It climbs the likelihood of ``b`` as Poisson counts of mean ``A x`` and keeps the total
    intensity; voxels never become negative. Negative pixels count as zero.

    Parameters
    ----------
    projector : Projector
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Must not be negative; a constant when None.
    nonnegative : bool
        Must be True: the method has no other form.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    Shepp and Vardi, "Maximum likelihood reconstruction for emission tomography", IEEE
    Transactions on Medical Imaging 1 (1982), equation 2.13.
    """
    check_nonnegative("mlem", nonnegative)
    measured = check_measured(projector, measured)
    counts = np.maximum(measured, 0)
    per_column = reciprocal(projector.column_sums)

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            projected = projector @ x
            yield x, norm(measured - projected)
            x = x * per_column * (projector.T @ ratio(counts, projected))

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "mlem", "nonnegative": True},
    )


def check_nonnegative(method: str, nonnegative: bool) -> None:
    """Refuse to run a multiplicative method without non-negativity."""
    if not nonnegative:
        raise ValueError(f"{method} nonnegative: found False, expected True (multiplicative)")
