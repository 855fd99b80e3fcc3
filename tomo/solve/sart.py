"""SART: the simultaneous algebraic reconstruction technique, one view at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo._groups import golden_section
from tomo._sums import norm
from tomo.reconstruction import Callback, Reconstruction
from tomo.solve._drive import (
    States,
    additive_start,
    check_measured,
    check_relaxation,
    drive,
    residual_of,
)
from tomo.solve._sweep import sweep_of
from tomo.viewed import ViewedOperator


def spread_order(count: int) -> list[int]:
    """Return ``0 .. count - 1`` so that neighbours in the order are far apart on the ring.

    Steps of the golden section: after any number of views, those used are spread evenly.
    """
    return [int(n) for n in np.argsort(np.argsort(golden_section(count)))]


def sart(
    projector: ViewedOperator,
    measured: ArrayLike,
    *,
    iterations: int = 10,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    relaxation: float = 1.0,
    callback: Callback | None = None,
) -> Reconstruction:
    """Solve by SART: SIRT's update from one view's rays at a time, views in a spread-out order.

    ``x <- x + r C_v A_v^T R_v (b_v - A_v x)`` for each view ``v``; one iteration is one pass over
    all views. Parameters are those of `tomo.solve.sirt`.

    References
    ----------
    Andersen and Kak, "Simultaneous algebraic reconstruction technique (SART)", Ultrasonic
    Imaging 6 (1984), equation 33.
    """
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    views = [number for number in range(projector.n_views) if np.diff(projector.view_ptr)[number]]
    parts = [projector.pixels_of([views[n]]) for n in spread_order(len(views))]
    sweep = sweep_of(projector, measured, parts)

    def states() -> States:
        x = additive_start(projector, start, nonnegative)
        while True:
            yield x, norm(residual_of(projector, measured, x))
            x = sweep(x, relaxation, nonnegative)

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "sart", "nonnegative": nonnegative, "relaxation": relaxation},
    )
