"""TV: least squares with a prior on total variation."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo.operators.operator import ProjectionOperator
from tomo.priors import TotalVariation
from tomo.solvers._parameters import shared_parameters
from tomo.solvers.proximal_gradient import proximal_gradient
from tomo.solvers.solution import Callback, Solution


@shared_parameters
def tv(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    strength: float = 0.005,
    iterations: int = 20,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct a smooth volume that keeps edges: the prior counts the size of gradients.

    Voxels that no ray meets follow their neighbours.

    Parameters
    ----------
    {projector}
    {measured}
    strength : float
        ``s``, >= 0. About 1e-4 for faint noise, 1e-2 for a lot.
    {iterations}
        Each takes one projection, one adjoint and a few steps on the grid alone.
    {start}
        The volume of a neighbouring strength saves most of the iterations.
    {nonnegative}
    {weights}
    {callback}

    Notes
    -----
    Minimises ``½ ||W^½ (b - A x)||² + s u TV(x)`` over ``x >= 0`` by
    `tomo.solvers.proximal_gradient`. ``TV`` is the sum of the lengths of the gradient
    (`tomo.priors.TotalVariation`); ``u`` the largest magnitude in ``A^T W b``. With it the
    strength ``s`` has no unit: the volume scales exactly with the images, and neither the scale of
    the weights, nor the unit of length, nor the number of rays matters; at about ``s = 1``
    everything vanishes. The strength that noise asks for grows with the noise and falls with the
    square root of the number of rays.

    References
    ----------
    Rudin, Osher and Fatemi, Physica D 60 (1992).
    """
    return proximal_gradient(
        projector, measured, prior=TotalVariation(projector.active), strength=strength,
        iterations=iterations, start=start, nonnegative=nonnegative, weights=weights,
        callback=callback, method="tv",
    )  # fmt: skip
