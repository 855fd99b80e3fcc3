"""The proximal gradient method: least squares with any proximal prior over ``x >= 0``."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import host, like, namespace, single, zeros
from tomo._compute.reductions import dot, largest
from tomo.losses import LeastSquares, check_prior, check_strength
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import damped
from tomo.priors import ProximalPrior
from tomo.solvers.iterate import States, drive, shared_parameters
from tomo.solvers.solution import Callback, Solution

DUAL_STEPS = 4
"""Steps of the proximal map at each update: more change nothing visible, fewer leave edges."""

FIRST_DUAL_STEPS = 40
"""Steps at the first update, which has no dual field to start from; fewer leave edges."""

RESTART_AFTER = 8
"""Updates at least between two restarts of the momentum: the first few point uphill by chance."""

BARELY_SEEN = 1e-3
"""Fraction of the median voxel's curvature below which steps do not grow: with less a voxel that
rays graze moves far, with more voxels at the rim are slow."""


@shared_parameters
def proximal_gradient(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    prior: ProximalPrior,
    strength: float,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
    method: str = "proximal_gradient",
) -> Solution:
    """Minimise least squares with a proximal prior by the optimised gradient method.

    Parameters
    ----------
    {projector}
    {measured}
    prior : ProximalPrior
        ``R``, see `tomo.priors`.
    strength : float
        ``s``, >= 0, without a unit.
    {iterations}
        Each takes one projection, one adjoint and a few steps on the grid alone.
    {start}
    {nonnegative}
    {weights}
    {callback}
    method : str
        The name in the settings of the solution.

    Notes
    -----
    Minimises ``½ ||W^½ (b - A x)||² + s u R(x)`` over ``x >= 0``, with ``u`` the largest magnitude
    in ``A^T W b``, for a prior ``R`` that grows with the intensity. The proximal optimised
    gradient method needs a third fewer updates than FISTA. It runs in the metric ``A^T W A 1``, in
    which the step is 1; the momentum restarts when it points uphill. The proximal map keeps its
    dual field from one update to the next.

    References
    ----------
    Kim and Fessler, "Adaptive restart of the optimized gradient method for convex optimization",
    Journal of Optimization Theory and Applications 178 (2018), algorithm 3; the metric: Erdoğan
    and Fessler, "Ordered subsets algorithms for transmission tomography", Physics in Medicine and
    Biology 44 (1999).
    """
    check_prior(prior, "proximal_map")
    problem = LeastSquares(projector, measured, weights)
    strength, xp = check_strength(strength), namespace(problem.measured)

    def states() -> States:
        x = problem.start(start, nonnegative)
        residual = problem.measured - problem.forward(x)
        yield problem.unit * x, problem.misfit(residual)
        inverse = _inverse(problem.curvature)
        if not bool(xp.any(inverse)):  # nothing is seen
            return
        proximal = prior.proximal_map(inverse, nonnegative)
        weight = strength * float(largest(xp.abs(problem.adjoint(problem.measured))))
        # omega, y, z, theta and zeta of the paper are landed, mapped, center, age and stretch.
        landed = mapped = center = x
        age, stretch, steps, since = 1.0, 1.0, FIRST_DUAL_STEPS, 0
        while True:
            fall = inverse * problem.adjoint(residual)
            landed, before = x + fall, landed
            older = (1 + math.sqrt(1 + 4 * age**2)) / 2
            center = (
                landed
                + single((age - 1) / older) * (landed - before)
                + single(age / older) * (landed - x)
                + single((age - 1) / (stretch * older)) * (center - x)
            )
            stretch = (2 * age + older - 1) / older
            moved = proximal(center, weight, steps if strength else 0, stretch)
            residual = problem.measured - problem.forward(moved)
            yield problem.unit * moved, problem.misfit(residual)
            uphill = (center - moved) / single(stretch) - fall
            mapped, before = x - uphill, mapped
            since += 1
            if since >= RESTART_AFTER and dot(uphill / inverse, mapped - before) > 0:
                older, since = 1.0, 0
            x, age, steps = moved, older, DUAL_STEPS

    settings = {
        "method": method,
        "strength": strength,
        "nonnegative": nonnegative,
        "weighted": weights is not None,
    }
    return drive(states(), projector, problem.measured, iterations, callback, settings)


def _inverse(curvature: NDArray[np.float32]) -> NDArray[Any]:
    """Return the step of every voxel, damped where it is barely seen; zeros where nothing is."""
    there = host(curvature)
    if not there.any():
        return zeros(curvature.shape, curvature)
    return like(1 / damped(there, BARELY_SEEN), curvature)
