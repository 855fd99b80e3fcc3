"""Projected conjugate gradients: least squares with any linear prior over ``x >= 0``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import chosen, factors, host, namespace, quotient
from tomo._compute.reductions import inner
from tomo.losses import LeastSquares, LinearPrior
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.iterate import States, drive, shared_parameters
from tomo.solvers.solution import Callback, Solution

LONGER = np.float32(1.5)
"""Steps as a multiple of the one before, before they are clipped and shortened to the lowest
objective. Shorter ones advance less at a time, longer ones clip more than the lowest needs."""

MOST = np.float32(3)
"""How many times as long as it was tried the next step may be taken for."""

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
        Each takes one adjoint and one projection.
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
    step somewhat longer than the one before is clipped at zero, and the way to the clipped volume
    shortened, or prolonged where nothing is clipped, to the lowest objective along it: one
    projection, and the objective falls at every update. When the free variables no longer change,
    it is the conjugate gradient method on them.
    Without the bound it is CGLS.

    References
    ----------
    Polyak, "The conjugate gradient method in extremal problems", USSR Computational Mathematics
    and Mathematical Physics 9 (1969); the projected search along a clipped direction: Nocedal and
    Wright, "Numerical Optimization" (2006), section 16.7.
    """
    problem = LeastSquares(projector, measured, weights, prior, strength)
    settings: dict[str, Any] = {"method": method} | (
        {} if prior is None else {"strength": strength}
    )
    settings |= {"nonnegative": nonnegative, "weighted": weights is not None}
    states = descend(problem, start, nonnegative)
    return drive(states, projector, problem.measured, iterations, callback, settings)


def descend(problem: LeastSquares, start: ArrayLike | None, nonnegative: bool) -> States:
    """Yield the volumes of projected conjugate gradients on ``problem``, see `projected_cg`.

    Columns have steps of their own; one that has no direction left stays, the last one ends all.
    """
    x = problem.start(start, nonnegative)
    xp = namespace(x)
    residual = problem.residual(x)
    downhill = problem.adjoint(residual)
    steepest = _free(x, downhill, nonnegative)
    size = first = inner(steepest, steepest)
    direction, step = steepest, None
    while True:
        yield problem.unit * x, problem.misfit(residual)
        # At the limit of single precision there is no direction left to go.
        moving = size > first * SINGLE_PRECISION**2
        if not np.any(moving):
            return
        change, image, further = _change(problem, x, direction, downhill, nonnegative, step)
        if not np.all(further > 0) and direction is not steepest:
            others = _change(problem, x, steepest, downhill, nonnegative, step)
            change, image, further = (
                chosen(further > 0, one, other)
                for one, other in zip((change, image, further), others, strict=True)
            )
        moving = moving & (further > 0)
        if not np.any(moving):
            return
        if not np.all(moving):
            change, image = (chosen(moving, one, 0.0) for one in (change, image))
        step = np.where(moving, further, np.float32(0) if step is None else step)
        x = xp.maximum(x + change, 0.0) if nonnegative else x + change
        residual = residual - image
        downhill = problem.adjoint(residual)
        previous, size_before = steepest, size
        steepest = _free(x, downhill, nonnegative)
        size = inner(steepest, steepest)
        turn = _ratio(size - inner(steepest, previous), size_before)
        direction = steepest + factors(turn, x) * _free(x, direction, nonnegative, downhill)


def _free(x, vector, nonnegative, downhill=None):
    """Return ``vector`` with zero for what is at zero and would go, or be driven, below."""
    if not nonnegative:
        return vector
    blocked = (x <= 0) & (vector <= 0)
    if downhill is not None:
        blocked |= (x <= 0) & (downhill <= 0)
    return namespace(x).where(blocked, 0.0, vector)


def _change(
    problem: LeastSquares,
    x: NDArray[np.float32],
    direction: NDArray[np.float32],
    downhill: NDArray[np.float32],
    nonnegative: bool,
    step: NDArray[np.float32] | None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return each column's feasible change along ``direction``, its image, and its step's length.

    ``step`` are the lengths of the last ones; zero is returned where no step leads lower.
    """
    xp = namespace(x)
    if step is None or not nonnegative:
        image = problem.forward(direction)
        best = _ratio(inner(direction, downhill), inner(image, image))
        along = factors(best, x)
        if not nonnegative or not bool(xp.any(x + along * direction < 0)):
            return along * direction, along * image, best
        step = best / LONGER
    longer = LONGER * step
    clipped = xp.maximum(x + factors(longer, x) * direction, 0.0) - x
    image = problem.forward(clipped)
    best = _ratio(inner(clipped, downhill), inner(image, image))
    # beyond one the change could be clipped once more
    beyond = (best > 1) & host(xp.any(x + factors(best, x) * clipped < 0, axis=0))
    fraction = factors(np.where(beyond, np.float32(1), best)[()], x)
    return fraction * clipped, fraction * image, longer * np.minimum(best, MOST)


def _ratio(above: ArrayLike, below: ArrayLike) -> NDArray[np.float32]:
    """Return ``above / below``, 0 where that is not positive or nothing is below."""
    return np.maximum(quotient(above, below), 0).astype(np.float32)
