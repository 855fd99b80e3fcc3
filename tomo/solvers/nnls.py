"""NNLS: non-negative least squares."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo.operators.operator import ProjectionOperator
from tomo.solvers._projected_cg import projected_conjugate_gradients
from tomo.solvers.iterate import drive
from tomo.solvers.least_squares import LeastSquares
from tomo.solvers.solution import Callback, Solution


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
    """Minimise ``||W^½ (b - A x)||`` over ``x >= 0`` by projected conjugate gradients.

    As fast as CGLS, but the volume is the best of the non-negative ones instead of the best of
    all, clipped; the residual falls at every update. On noisy images it must be stopped early.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
        Updates; each takes one adjoint and one or two projections.
    start : (voxels,), optional
        Zeros when None.
    nonnegative : bool
        Without, it is CGLS.
    weights : (pixels,), optional
        The diagonal of ``W``, such as the inverse variances of the pixels; ones when None. With
        weights the history holds ``||W^½ (b - A x)|| / ||W^½ b||``.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    See `tomo.solvers._projected_cg`; for the problem, Lawson and Hanson, "Solving Least Squares
    Problems" (1974), chapter 23.
    """
    problem = LeastSquares(projector, measured, weights)
    return drive(
        projected_conjugate_gradients(problem, start, nonnegative),
        projector,
        problem.measured,
        iterations=iterations,
        callback=callback,
        settings={"method": "nnls", "nonnegative": nonnegative, "weighted": weights is not None},
    )
