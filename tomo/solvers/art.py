"""ART: the algebraic reconstruction technique, Kaczmarz's method."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo._compute.jit import compiled
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.operators.spmv import row_product
from tomo.operators.vectors import additive_start, check_measured, damped
from tomo.solvers._rows import merged_rows
from tomo.solvers.iterate import States, check_relaxation, drive, shared_parameters
from tomo.solvers.solution import Callback, Solution


@compiled()
def _squared_norms(ptr, length, squares):
    """Write every row's squared norm."""
    for pixel in range(len(squares)):
        for slot in range(ptr[pixel], ptr[pixel + 1]):
            squares[pixel] += np.float64(length[slot]) ** 2


@compiled()
def _sweep(ptr, voxel, length, measured, order, steps, nonnegative, volume):
    """Move ``volume`` towards each pixel's equation in turn, in place."""
    for pixel in order:
        projected = row_product(volume, voxel, length, ptr[pixel], ptr[pixel + 1])
        step = steps[pixel] * (measured[pixel] - projected)
        for slot in range(ptr[pixel], ptr[pixel + 1]):
            moved = volume[voxel[slot]] + step * length[slot]
            volume[voxel[slot]] = max(moved, 0.0) if nonnegative else moved


@shared_parameters
def art(
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
    """Reconstruct by Kaczmarz's method: one pixel's equation at a time.

    One iteration is one sweep over all pixels, in an order drawn once from ``seed``: rays that
    follow each other are then nearly independent, which makes the method fast. Several rays of
    one pixel form one equation.

    Parameters
    ----------
    {stored_projector}
    {measured}
    {iterations}
    {start}
    {nonnegative}
    {relaxation}
        Below 1 it damps noise.
    {seed}
    {callback}

    Notes
    -----
    ``x <- x + r (b_p - a_p . x) a_p / ||a_p||^2`` for one pixel ``p`` at a time. The step of a ray
    that barely meets voxels is divided by a tenth of the median row's ``||a||^2`` instead
    (`tomo.operators.vectors.damped`).

    References
    ----------
    Gordon, Bender and Herman, "Algebraic reconstruction techniques (ART)", Journal of Theoretical
    Biology 29 (1970); Kaczmarz (1937).
    """
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    rows = merged_rows(projector, "art")
    squares = np.zeros(len(measured))
    _squared_norms(rows[0], rows[2], squares)
    steps = relaxation / damped(squares)
    order = np.random.default_rng(seed).permutation(np.flatnonzero(np.diff(rows[0])))

    def states() -> States:
        x = additive_start(projector, start, nonnegative)
        while True:
            yield x, norm(measured - projector @ x)
            x = x.copy()
            _sweep(*rows, measured, order, steps, nonnegative, x)

    settings = {
        "method": "art",
        "nonnegative": nonnegative,
        "relaxation": relaxation,
        "seed": seed,
    }
    return drive(states(), projector, measured, iterations, callback, settings)
