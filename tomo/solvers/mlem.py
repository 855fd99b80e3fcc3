"""MLEM: maximum likelihood by expectation maximisation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import as_type, namespace, taken
from tomo._compute.reductions import norm
from tomo.losses import Poisson, check_prior, check_strength
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured, multiplicative_start
from tomo.priors import ProximalPrior
from tomo.solvers.iterate import States, check_nonnegative, drive, interleaved, shared_parameters
from tomo.solvers.solution import Callback, Solution

DUAL_STEPS = 20
"""Steps of a prior's proximal map at each update, whose metric is another each time. Fewer leave
the volume off the minimum, more change nothing visible."""


@shared_parameters
def mlem(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 50,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    subsets: int = 1,
    prior: ProximalPrior | None = None,
    strength: float = 0.0,
    callback: Callback | None = None,
) -> Solution:
    """Find the volume under which the images, as photon counts, are most likely.

    Every update raises the likelihood and keeps the total intensity; voxels never become negative.
    Negative pixels count as zero.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
    {positive_start}
    {always_nonnegative}
    subsets : int
        Above 1, each iteration updates once from each of so many interleaved subsets of the pixels
        (every one sees all views), which makes one iteration nearly worth ``subsets``.
    prior : ProximalPrior, optional
        ``R``, see `tomo.priors`.
    strength : float
        ``s``, >= 0, without a unit: how much the prior counts.
    {callback}

    Notes
    -----
    ``x <- x / (A^T 1) * A^T (b / A x)`` minimises the negative log-likelihood
    `tomo.losses.Poisson` by expectation maximisation. `tomo.losses.sensitivity` damps the updates
    of voxels that rays, or a subset's rays, barely see.

    With a prior it minimises ``L(x) + s l R(x)``, ``l`` the largest column sum of ``A``. The
    update is a step along the gradient of ``L`` in the metric ``C = x / A^T 1``; the proximal map
    of the prior in the same metric follows it.

    References
    ----------
    Shepp and Vardi, "Maximum likelihood reconstruction for emission tomography", IEEE
    Transactions on Medical Imaging 1 (1982), equation 2.13. Hudson and Larkin, "Accelerated image
    reconstruction using ordered subsets of projection data", ibid. 13 (1994). With a prior:
    Sawatzky, Brune, Wübbeling, Kösters, Schäfers and Burger, "Accurate EM-TV algorithm in PET with
    low SNR", IEEE Nuclear Science Symposium (2008).
    """
    check_nonnegative("mlem", nonnegative)
    measured = check_measured(projector, measured)
    parts = interleaved(projector.shape[0], subsets)
    fair = projector.column_sums / len(parts)
    longest = float(projector.column_sums.max(initial=0.0))
    if prior is not None:
        check_prior(prior, "proximal_map")
    weight = 0.0 if prior is None else check_strength(strength) * longest / len(parts)
    losses = [
        Poisson(
            projector.take(pixels) if subsets > 1 else projector, taken(measured, pixels), fair
        )
        for pixels in parts
    ]
    counts = namespace(measured).maximum(measured, 0.0)

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            projected = projector @ x
            yield x, norm(measured - projected)
            for loss in losses:
                if subsets > 1:
                    projected = loss.projector @ x
                moved = as_type(x * loss.factor(projected), np.float32)
                if prior is not None and weight > 0:
                    moved = prior.proximal_map(loss.step(x), True)(moved, weight, DUAL_STEPS)
                x = moved

    settings: dict[str, Any] = {"method": "mlem", "nonnegative": True, "subsets": subsets}
    if prior is not None:
        settings["strength"] = strength
    return drive(states(), projector, measured, iterations, callback, settings)


def mlem_of_several(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    iterations: int,
    start: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the volumes of `mlem` up to rounding, where they are computed.

    Each product serves all columns of ``measured`` (pixels, columns) and of ``start`` and the
    result (unknowns, columns): frames of a film, or repeats of one with other noise.
    """
    loss = Poisson(projector, projector.array(measured), projector.column_sums)
    volumes = projector.array(start)
    for _ in range(iterations):
        with projector.computing():
            volumes = as_type(volumes * loss.factor(projector @ volumes), np.float32)
    return volumes
