"""CGLS: conjugate gradients for least squares."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo._compute.arrays import namespace, single
from tomo._compute.reductions import norm
from tomo.losses import LeastSquares, LinearPrior
from tomo.operators.operator import ProjectionOperator
from tomo.priors import Magnitude
from tomo.solvers.iterate import States, drive, shared_parameters
from tomo.solvers.projected_cg import SINGLE_PRECISION
from tomo.solvers.solution import Callback, Solution

RISEN = 1 + 1e-6
"""Factor by which the misfit may exceed its lowest value. It rises by rounding only, after which
the recurrence grows without bound; a smaller factor stops on the rounding of one sum."""


@shared_parameters
def cgls(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    prior: LinearPrior | None = None,
    strength: float = 0.0,
    callback: Callback | None = None,
) -> Solution:
    """Find the volume of least squares by conjugate gradients.

    The fastest of the classic methods on clean images; on noisy ones it must be stopped early.
    `tomo.solvers.nnls` finds the best non-negative volume in hardly more time.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
    {start}
    nonnegative : bool
        Whether each volume passed on is ``max(x, 0)``. The iteration goes on from the unclipped
        ``x``, whose residual the history holds.
    {weights}
    prior : LinearPrior, optional
        ``D``, see `tomo.priors`; when None the identity, whose strength is damping.
    strength : float
        ``s``, >= 0. ``m`` is the largest element of ``A^T W A 1``, so that ``s`` has no
        unit.
    {callback}

    Notes
    -----
    Minimises ``||W^½ (b - A x)||² + s m ||D x||²`` (`tomo.losses.LeastSquares`), without a
    preconditioner: the reciprocal column sums save no iteration on views of a flame. The
    recurrence's residual, in single precision with scalars in double, stays true far beyond 1e-8,
    so that it is never computed anew. The iteration ends where the gradient is no more than
    rounding: at ``eps ||A|| ||b - A x||``, which images that no volume explains, such as noise or
    an outlier, reach long before ``eps`` times the first gradient.

    References
    ----------
    Hestenes and Stiefel, "Methods of conjugate gradients for solving linear systems", Journal of
    Research of the National Bureau of Standards 49 (1952), section 10; Björck, "Numerical
    Methods for Least Squares Problems" (1996), algorithm 7.4.1.
    """
    prior = Magnitude() if prior is None else prior
    problem = LeastSquares(projector, measured, weights, prior, strength)
    xp = namespace(problem.measured)

    def states() -> States:
        x = problem.start(start, nonnegative=False)
        residual = problem.residual(x)
        gradient = problem.adjoint(residual)
        direction = gradient
        gamma = gamma_start = norm(gradient) ** 2
        lowest, steepest = norm(residual), 0.0
        while True:
            volume = xp.maximum(x, 0.0) if nonnegative else x
            yield problem.unit * volume, problem.misfit(residual)
            image = problem.forward(direction)
            curvature = norm(image) ** 2
            if curvature == 0:
                return
            # A smaller gradient is the rounding of its own sums; ||A||² is the largest curvature
            # met.
            steepest = max(steepest, curvature / norm(direction) ** 2)
            rounding = max(gamma_start, 4 * steepest * norm(residual) ** 2)
            if gamma <= rounding * SINGLE_PRECISION**2:
                return
            step = single(gamma / curvature)
            x = x + step * direction
            residual = residual - step * image
            misfit = norm(residual)
            if misfit > RISEN * lowest:
                return
            lowest = min(lowest, misfit)
            gradient = problem.adjoint(residual)
            gamma, previous = norm(gradient) ** 2, gamma
            direction = gradient + single(gamma / previous) * direction

    settings = {
        "method": "cgls",
        "nonnegative": nonnegative,
        "weighted": weights is not None,
        "strength": strength,
    }
    return drive(states(), projector, problem.measured, iterations, callback, settings)
