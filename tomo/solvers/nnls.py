"""NNLS: non-negative least squares."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo.operators.operator import ProjectionOperator
from tomo.solvers._parameters import shared_parameters
from tomo.solvers.projected_cg import projected_cg
from tomo.solvers.solution import Callback, Solution


@shared_parameters
def nnls(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Find the volume of least squares that is not negative.

    As fast as CGLS, but the volume is the best of the non-negative ones instead of the best of
    all, clipped. On noisy images it must be stopped early.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
        Each takes one adjoint and one or two projections.
    {start}
    {nonnegative}
        Without, it is CGLS.
    {weights}
    {callback}

    Notes
    -----
    Minimises ``||W^½ (b - A x)||²`` over ``x >= 0`` by `tomo.solvers.projected_cg`, without a
    prior.

    References
    ----------
    Lawson and Hanson, "Solving Least Squares Problems" (1974), chapter 23.
    """
    return projected_cg(
        projector, measured, iterations=iterations, start=start, nonnegative=nonnegative,
        weights=weights, callback=callback, method="nnls",
    )  # fmt: skip
