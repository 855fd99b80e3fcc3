"""MART: the multiplicative algebraic reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo._compute.jit import compiled
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.operators.spmv import row_product
from tomo.operators.vectors import check_measured, damped, multiplicative_start
from tomo.solvers._rows import merged_rows
from tomo.solvers.iterate import (
    States,
    check_nonnegative,
    check_relaxation,
    drive,
    shared_parameters,
)
from tomo.solvers.solution import Callback, Solution


@compiled()
def _sweep(ptr, voxel, length, measured, order, powers, volume):
    """Scale the voxels along each pixel's rays in turn towards its measurement, in place."""
    for pixel in order:
        projected = row_product(volume, voxel, length, ptr[pixel], ptr[pixel + 1])
        if projected <= 0.0:
            continue
        quotient = measured[pixel] / projected
        for slot in range(ptr[pixel], ptr[pixel + 1]):
            volume[voxel[slot]] *= quotient ** (powers[pixel] * length[slot])


@shared_parameters
def mart(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 10,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    relaxation: float = 0.5,
    seed: int = 0,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct by multiplicative updates, one pixel at a time.

    One iteration is one sweep over all pixels in an order drawn once from ``seed``. A pixel that
    is zero (or negative, which counts as zero) empties every voxel that it sees, for good.

    Parameters
    ----------
    {stored_projector}
    {measured}
    {iterations}
    {positive_start}
    {always_nonnegative}
    {relaxation}
        At most 1 in practice.
    {seed}
    {callback}

    Notes
    -----
    ``x_v <- x_v (b_p / a_p . x)^(r a_pv / max a_p)`` for one pixel ``p`` at a time. Among all
    volumes that reproduce the images it tends to the one of largest entropy. Where a ray barely
    meets voxels, ``max a_p`` is a tenth of the median row's instead
    (`tomo.operators.vectors.damped`).

    References
    ----------
    Gordon, Bender and Herman, Journal of Theoretical Biology 29 (1970); the exponent's
    normalisation after Verhoeven, "Limited-data computed tomography algorithms for the physical
    sciences", Applied Optics 32 (1993), equation 22.
    """
    check_nonnegative("mart", nonnegative)
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    counts = np.maximum(measured, 0)
    rows = merged_rows(projector, "mart")
    crossing = np.flatnonzero(np.diff(rows[0]))
    longest = np.zeros(len(counts))
    if len(crossing):
        longest[crossing] = np.maximum.reduceat(rows[2], rows[0][crossing])
    powers = relaxation / damped(longest)
    order = np.random.default_rng(seed).permutation(crossing)

    def states() -> States:
        x = multiplicative_start(projector, counts, start)
        while True:
            yield x, norm(measured - projector @ x)
            x = x.copy()
            _sweep(*rows, counts, order, powers, x)

    settings = {"method": "mart", "nonnegative": True, "relaxation": relaxation, "seed": seed}
    return drive(states(), projector, measured, iterations, callback, settings)
