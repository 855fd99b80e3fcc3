"""SART: the simultaneous algebraic reconstruction technique, one view at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import golden_ratio_sequence
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import additive_start, check_measured
from tomo.solvers._block_sweep import sweep_of
from tomo.solvers.iterate import (
    States,
    check_relaxation,
    drive,
    residual_of,
    shared_parameters,
)
from tomo.solvers.solution import Callback, Solution


def view_orders(count: int) -> Iterator[NDArray[np.int64]]:
    """Yield the order in which each pass takes views ``0 .. count - 1``, without end.

    The first has no pattern. In all others neighbours in the order are far apart on the ring, and
    those used after any number of views are spread evenly, by the golden-ratio sequence.
    """
    yield np.random.default_rng(0).permutation(count)
    spread = np.argsort(np.argsort(golden_ratio_sequence(count)))
    while True:
        yield spread


@shared_parameters
def sart(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 10,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    relaxation: float = 1.0,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct by SIRT's update from one view at a time, views in a spread-out order.

    One iteration is one pass over all views.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
    {start}
    {nonnegative}
    {relaxation}
    {callback}

    Notes
    -----
    ``x <- x + r C_v A_v^T R_v (b_v - A_v x)`` for each view ``v``, with ``C`` and ``R`` as in
    `tomo.solvers.sirt`.

    A pass from zeros takes the views in an order without any pattern: after one in even steps
    round the ring, the volume stays further from the truth in all passes to come. A run from a
    ``start`` has even orders only.

    References
    ----------
    Andersen and Kak, "Simultaneous algebraic reconstruction technique (SART)", Ultrasonic
    Imaging 6 (1984), equation 33.
    """
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    views = [number for number in range(projector.n_views) if np.diff(projector.view_ptr)[number]]
    sweep = sweep_of(projector, measured, [projector.pixels_of([view]) for view in views])

    def states() -> States:
        x = additive_start(projector, start, nonnegative)
        orders = view_orders(len(views))
        if start is not None:
            next(orders)
        for order in orders:
            yield x, norm(residual_of(projector, measured, x))
            x = sweep(x, relaxation, nonnegative, order)

    settings = {"method": "sart", "nonnegative": nonnegative, "relaxation": relaxation}
    return drive(states(), projector, measured, iterations, callback, settings)
