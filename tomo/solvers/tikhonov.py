"""Tikhonov: least squares with a prior on differences of neighbouring voxels."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo.operators.operator import ProjectionOperator
from tomo.priors import Gradient
from tomo.solvers._parameters import shared_parameters
from tomo.solvers.projected_cg import projected_cg
from tomo.solvers.solution import Callback, Solution


@shared_parameters
def tikhonov(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    strength: float = 1e-3,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct a smooth volume: the prior counts differences of neighbours.

    It smooths noise and edges alike; `tomo.solvers.tv` keeps edges. Voxels that no ray meets
    follow their neighbours.

    Parameters
    ----------
    {projector}
    {measured}
    strength : float
        ``s``, >= 0. About 1e-4 for faint noise, 1e-2 for a lot.
    {iterations}
        Each takes one adjoint and one or two projections.
    {start}
        The volume of a neighbouring strength saves most of the iterations.
    {nonnegative}
    {weights}
    {callback}

    Notes
    -----
    Minimises ``||W^½ (b - A x)||² + s m ||D x||²`` over ``x >= 0`` by `tomo.solvers.projected_cg`.
    ``D`` takes the differences of neighbouring voxels (`tomo.priors.Gradient`), ``m`` is the
    largest element of ``A^T W A 1``: the strength ``s`` has no unit, and the volume scales with
    the images.

    References
    ----------
    Tikhonov, "Solution of incorrectly formulated problems and the regularization method", Soviet
    Mathematics 4 (1963).
    """
    return projected_cg(
        projector, measured, prior=Gradient(projector.active), strength=strength,
        iterations=iterations, start=start, nonnegative=nonnegative, weights=weights,
        callback=callback, method="tikhonov",
    )  # fmt: skip
