"""SIRT: simultaneous iterative reconstruction technique."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers._block_sweep import Block, sweep_of
from tomo.solvers.iterate import (
    States,
    additive_start,
    check_measured,
    check_relaxation,
    drive,
    residual_of,
)
from tomo.solvers.least_squares import check_weights
from tomo.solvers.mlem import interleaved
from tomo.solvers.solution import Callback, Solution


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
    """Solve by SIRT: ``x <- x + r C A^T W R (b - A x)``.

    ``R`` are the reciprocals of the row sums of A, or of a tenth of the median one where a ray
    barely crosses voxels, whose noise would throw them far off; ``C`` those of ``A^T W 1``. It
    descends the weighted least squares ``(b - A x)^T W R (b - A x)`` and converges for
    ``0 < r < 2``.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        The images, flat.
    iterations : int
    start : (voxels,), optional
        Zeros when None.
    nonnegative : bool
        Whether the start and each update become ``max(x, 0)``.
    weights : (pixels,), optional
        The diagonal of ``W``, such as the inverse variances of the pixels; ones when None. With
        weights the history holds ``||W^½ (b - A x)|| / ||W^½ b||``.
    relaxation : float
        ``r``.
    subsets : int
        Above 1, each iteration updates once from each of as many interleaved parts of the pixels
        (every part sees all views), which makes one iteration nearly worth ``subsets``; it then
        ends in a cycle around the solution, as small as the images are consistent. Of a voxel that
        a part hardly sees the column sum counts as the even share of all parts. Whole views as
        parts: `tomo.solvers.sart`.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

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
    root = None if weights is None else np.sqrt(weights)
    whole = Block(projector, measured, weights) if subsets == 1 else None
    if whole is None:
        parts = interleaved(len(measured), subsets)
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

    return drive(
        states(),
        projector,
        measured if root is None else root * measured,
        iterations=iterations,
        callback=callback,
        settings={
            "method": "sirt",
            "nonnegative": nonnegative,
            "weighted": weights is not None,
            "relaxation": relaxation,
            "subsets": subsets,
        },
    )
