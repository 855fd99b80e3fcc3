"""Tikhonov: least squares with a penalty on differences of neighbouring voxels."""

from __future__ import annotations

from numpy.typing import ArrayLike

from tomo.operators.operator import ProjectionOperator
from tomo.priors.differences import Gradient
from tomo.solvers._projected_cg import projected_conjugate_gradients
from tomo.solvers.iterate import drive
from tomo.solvers.least_squares import LeastSquares
from tomo.solvers.solution import Callback, Solution


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
    """Minimise ``||W^½ (b - A x)||² + s m ||D x||²`` over ``x >= 0``: a smooth volume.

    ``D`` takes the differences of neighbouring voxels (`tomo.priors.differences`), ``m`` is the
    largest element of ``A^T W A 1``: the strength ``s`` has no unit, and the volume scales with
    the images. It smooths noise and edges alike; `tomo.solvers.tv` keeps edges. Voxels that no ray
    crosses follow their neighbours.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
        The images, flat.
    strength : float
        ``s``, >= 0. About 1e-4 for faint noise, 1e-2 for a lot.
    iterations : int
        Updates; each takes one adjoint and one or two projections.
    start : (voxels,), optional
        Zeros when None; the volume of a neighbouring strength saves most of the iterations.
    nonnegative : bool
        Whether voxels below zero are excluded.
    weights : (pixels,), optional
        The diagonal of ``W``, such as the inverse variances of the pixels; ones when None. With
        weights the history holds ``||W^½ (b - A x)|| / ||W^½ b||``.
    callback : callable, optional
        ``callback(index, volume, relative_residual)``; returns True to stop.

    References
    ----------
    Tikhonov, "Solution of incorrectly formulated problems and the regularization method", Soviet
    Mathematics 4 (1963); the solver is that of `tomo.solvers.nnls`.
    """
    problem = LeastSquares(projector, measured, weights, Gradient(projector.active), strength)
    return drive(
        projected_conjugate_gradients(problem, start, nonnegative),
        projector,
        problem.measured,
        iterations=iterations,
        callback=callback,
        settings={
            "method": "tikhonov",
            "strength": strength,
            "nonnegative": nonnegative,
            "weighted": weights is not None,
        },
    )
