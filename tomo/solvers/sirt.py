"""SIRT: simultaneous iterative reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo._compute.arrays import namespace
from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import additive_start, check_measured, check_weights
from tomo.solvers._block_sweep import Block, sweep_of
from tomo.solvers.iterate import (
    States,
    check_relaxation,
    drive,
    interleaved,
    residual_of,
    shared_parameters,
)
from tomo.solvers.solution import Callback, Solution


@shared_parameters
def sirt(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    iterations: int = 100,
    start: ArrayLike | None = None,
    nonnegative: bool = True,
    weights: ArrayLike | None = None,
    relaxation: float = 1.0,
    subsets: int = 1,
    callback: Callback | None = None,
) -> Solution:
    """Reconstruct by simultaneous updates from all rays, or from subsets of them.

    Parameters
    ----------
    {projector}
    {measured}
    {iterations}
    {start}
    {nonnegative}
    {weights}
    {relaxation}
    subsets : int
        Above 1, each iteration updates once from each of so many interleaved subsets of the pixels
        (every one sees all views), which makes one iteration nearly worth ``subsets``; it then
        ends in a cycle around the solution, the smaller the more consistent the images are. The
        column sum of a voxel that a subset hardly sees counts as the mean of all subsets. With
        whole views as subsets: `tomo.solvers.sart`.
    {callback}

    Notes
    -----
    ``x <- x + r C A^T W R (b - A x)``: ``R`` are the reciprocals of the row sums of ``A``, or of a
    tenth of the median one where a ray barely meets voxels (`tomo.operators.vectors.damped`);
    ``C`` are those of ``A^T W 1``. It minimises ``(b - A x)^T W R (b - A x)`` and converges for
    ``0 < r < 2``.

    References
    ----------
    Gregor and Benson, "Computational analysis and improvement of SIRT", IEEE Transactions on
    Medical Imaging 27 (2008), equation 4; ordered subsets: Censor and Elfving, "Block-iterative
    algorithms with diagonally scaled oblique projections", SIAM Journal on Matrix Analysis and
    Applications 24 (2002).
    """
    measured = check_measured(projector, measured)
    relaxation = check_relaxation(relaxation)
    weights = check_weights(projector, weights)
    root = None if weights is None else namespace(weights).sqrt(weights)
    whole = Block(projector, measured, weights) if subsets == 1 else None
    if whole is None:
        parts = interleaved(projector.shape[0], subsets)
        sweep = sweep_of(projector, measured, parts, weights, fair=True)

    def states() -> States:
        x = additive_start(projector, start, nonnegative)
        while True:
            residual = residual_of(projector, measured, x)
            yield x, norm(residual if root is None else root * residual)
            if whole is None:
                x = sweep(x, relaxation, nonnegative, np.arange(subsets))
            else:
                x = whole.updated(x, residual, relaxation, nonnegative)

    weighted = measured if root is None else root * measured
    settings = {
        "method": "sirt",
        "nonnegative": nonnegative,
        "weighted": weights is not None,
        "relaxation": relaxation,
        "subsets": subsets,
    }
    return drive(states(), projector, weighted, iterations, callback, settings)
