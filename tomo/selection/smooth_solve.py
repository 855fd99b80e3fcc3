"""The solve whose smoothness is chosen: a likely start, then least squares with a prior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.curvature import curvature
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem
from tomo.solvers.several import curvature_of_several, mlem_of_several
from tomo.solvers.solution import Callback, Solution

START = 10
"""Iterations of MLEM that find the brightness by which the prior weighs. Fewer leave ghosts of the
rays, more bring the noise in."""


def smooth_start(
    projector: ProjectionOperator, measured: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the volume that `solve_smoothly` starts from: a few MLEM updates.

    ``(unknowns,)`` of images ``(pixels,)``; with a last axis of columns where these have one.
    """
    start = mlos_start(projector, measured)
    if measured.ndim == 2:
        return mlem_of_several(projector, measured, iterations=START, start=start)
    found = mlem(projector, measured, iterations=START, start=start)
    return projector.active.compress(found.volume)


def solve_several_smoothly(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    width: float,
    strength: float,
    iterations: int,
    start: NDArray[np.float32],
    weights: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return the volumes of `solve_smoothly` of several sets of images, ``(unknowns, columns)``.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels, columns) float32
    width, strength, iterations
        See `solve_smoothly`.
    start : (unknowns, columns) float32
    weights : (pixels, columns) float32, optional
    """
    basis = GaussianBasis(projector, width) if width else None
    found = curvature_of_several(
        basis or projector,
        measured,
        strength=strength,
        iterations=iterations,
        start=start,
        weights=weights,
    )
    return basis.to_voxels(found) if basis else found


def solve_smoothly(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    *,
    width: float,
    strength: float,
    iterations: int,
    start: NDArray[np.float32],
    weights: NDArray[np.float32] | None = None,
    callback: Callback | None = None,
) -> Solution:
    """Solve least squares with a prior on relative curvature, on blobs of some width.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,) float32
    width : float
        Standard deviation of the Gaussian basis, in voxels; 0 for none.
    strength, iterations
        See `tomo.solvers.curvature`.
    start : (unknowns,) float32
        See `smooth_start`.
    weights : (pixels,) float32, optional
    callback : callable, optional
        Receives the volume itself, not the coefficients of the blobs.
    """
    basis = GaussianBasis(projector, width) if width else None

    def report(index: int, unknowns: NDArray[np.float32], residual: float) -> bool | None:
        volume = basis.to_voxels(unknowns) if basis else unknowns
        return None if callback is None else callback(index, volume, residual)

    found = curvature(
        basis or projector,
        measured,
        strength=strength,
        iterations=iterations,
        start=start,
        weights=weights,
        callback=report if callback else None,
    )
    return replace(
        found,
        volume=basis.volume(found.volume) if basis else found.volume,
        settings={**found.settings, "smooth_width": width},
    )
