"""Projected conjugate gradients: least squares with any linear prior over ``x >= 0``."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import dot, norm
from tomo.losses import LeastSquares, LinearPrior
from tomo.operators.operator import ProjectionOperator
from tomo.solvers._parameters import shared_parameters
from tomo.solvers.iterate import States, drive
from tomo.solvers.solution import Callback, Solution

SINGLE_PRECISION = float(np.finfo(np.float32).eps)


@shared_parameters
def projected_cg(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    prior: LinearPrior | None = None,
    strength: float = 0.0,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
    method: str = "projected_cg",
) -> Solution:
    """Minimise least squares with a linear prior by projected conjugate gradients.

    Parameters
    ----------
    {projector}
    {measured}
    prior : LinearPrior, optional
        ``D``, see `tomo.priors`.
    strength : float
        ``s``, >= 0, without a unit.
    {iterations}
        Each takes one adjoint and one or two projections.
    {start}
    {nonnegative}
    {weights}
    {callback}
    method : str
        The name in the settings of the solution.

    Notes
    -----
    Minimises ``||W^½ (b - A x)||² + s m ||D x||²`` over ``x >= 0`` (`tomo.losses.LeastSquares`).
    Conjugate gradients (Polak and Ribière's, with a factor that is never negative) run in the
    variables that are free: those above zero, and those at zero that the gradient would raise. A
    step that leads below zero is clipped, and the step to the clipped volume is shortened to the
    lowest objective along it, which takes one more projection; the objective falls at every
    update. When the free variables no longer change, it is the conjugate gradient method on them.
    Without the bound it is CGLS.

    References
    ----------
    Polyak, "The conjugate gradient method in extremal problems", USSR Computational Mathematics
    and Mathematical Physics 9 (1969); the projected search along a clipped direction: Nocedal and
    Wright, "Numerical Optimization" (2006), section 16.7.
    """
    problem = LeastSquares(projector, measured, weights, prior, strength)
    settings = {"method": method} | ({} if prior is None else {"strength": strength})
    return drive(
        descend(problem, start, nonnegative),
        projector,
        problem.measured,
        iterations=iterations,
        callback=callback,
        settings=settings | {"nonnegative": nonnegative, "weighted": weights is not None},
    )


def descend(problem: LeastSquares, start: ArrayLike | None, nonnegative: bool) -> States:
    """Yield the volumes of projected conjugate gradients on ``problem``, see `projected_cg`."""
    x = problem.start(start, nonnegative)
    residual = problem.residual(x)
    downhill = problem.adjoint(residual)
    steepest = _free(x, downhill, nonnegative)
    size = first = norm(steepest) ** 2
    direction = steepest
    while True:
        yield problem.unit * x, problem.misfit(residual)
        # At the limit of single precision there is no direction left to go.
        if size <= first * SINGLE_PRECISION**2:
            return
        change, image = _change(problem, x, direction, downhill, nonnegative)
        if change is None and direction is not steepest:
            change, image = _change(problem, x, steepest, downhill, nonnegative)
        if change is None:
            return
        x = np.maximum(x + change, 0) if nonnegative else x + change
        residual = residual - image
        downhill = problem.adjoint(residual)
        previous, size_before = steepest, size
        steepest = _free(x, downhill, nonnegative)
        size = norm(steepest) ** 2
        turn = max((size - dot(steepest, previous)) / size_before, 0.0)
        direction = steepest + np.float32(turn) * _free(x, direction, nonnegative, downhill)


def _free(x, vector, nonnegative, downhill=None):
    """Return ``vector`` with zero for what is at zero and would go, or be driven, below."""
    if not nonnegative:
        return vector
    blocked = (x <= 0) & (vector <= 0)
    if downhill is not None:
        blocked |= (x <= 0) & (downhill <= 0)
    return np.where(blocked, np.float32(0), vector)


def _change(
    problem: LeastSquares,
    x: NDArray[np.float32],
    direction: NDArray[np.float32],
    downhill: NDArray[np.float32],
    nonnegative: bool,
) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
    """Return the best feasible change along ``direction`` and its image; None if none descends."""
    image = problem.forward(direction)
    slope, curvature = dot(direction, downhill), norm(image) ** 2
    if slope <= 0 or curvature == 0:
        return None, None
    step = np.float32(slope / curvature)
    change = step * direction
    if not nonnegative or (x + change >= 0).all():
        return change, step * image
    change = np.maximum(x + change, 0) - x
    image = problem.forward(change)
    slope, curvature = dot(change, downhill), norm(image) ** 2
    if slope <= 0 or curvature == 0:
        return None, None
    step = np.float32(min(slope / curvature, 1.0))
    return step * change, step * image
