"""SART: the simultaneous algebraic reconstruction technique, one view at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.grouping import golden_section
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers._block_sweep import sweep_of
from tomo.solvers.iterate import (
    States,
    additive_start,
    check_measured,
    check_relaxation,
    drive,
    residual_of,
)
from tomo.solvers.solution import Callback, Solution


def view_orders(count: int) -> Iterator[NDArray[np.int64]]:
    """Yield the order in which each pass takes views ``0 .. count - 1``, without end.

    The first without any pattern. All others so that neighbours in the order are far apart on the
    ring, by steps of the golden section: after any number of views, those used are spread evenly.
    """
    yield np.random.default_rng(0).permutation(count)
    spread = np.argsort(np.argsort(golden_section(count)))
    while True:
        yield spread


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
    """Solve by SART: SIRT's update from one view's rays at a time, views in a spread-out order.

    ``x <- x + r C_v A_v^T R_v (b_v - A_v x)`` for each view ``v``; one iteration is one pass over
    all views. Parameters are those of `tomo.solvers.sirt`.

    Notes
    -----
    A pass from zeros takes the views in an order without any pattern. After one in even steps
    round the ring, 33 views of a jet on exact data left the volume twice as far from the truth,
    and it stayed so in the passes to come (12 random orders: 1.2 to 2.6 times as far after the
    first pass). How far it gets on images with errors is up to the passes that follow, and a run
    that goes on from a ``start`` has only such.

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

    return drive(
        states(),
        projector,
        measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "sart", "nonnegative": nonnegative, "relaxation": relaxation},
    )
