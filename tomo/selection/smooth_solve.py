"""The solve whose smoothness is chosen: from a likely start, with a prior or by MLEM."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import factors, host, namespace, quotient
from tomo._compute.reductions import largest
from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.curvature import curvature, curvature_of_several
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem, mlem_of_several
from tomo.solvers.projected_cg import SINGLE_PRECISION
from tomo.solvers.solution import Callback, Solution

START = 10
"""Iterations of MLEM that find the brightness by which the prior weighs. Fewer leave ghosts of the
rays, more bring the noise in."""

UNBLURRED = 20
"""Updates that turn the start into coefficients of the blobs, without a product with the matrix.
Fewer leave it blurred, which takes the solve 20 to 60 iterations to mend; more change nothing."""


def smooth_start(
    projector: ProjectionOperator, measured: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the volume that `solve_smoothly` starts from: a few MLEM updates.

    ``(unknowns,)`` of images ``(pixels,)``; with a last axis of columns where these have one, and
    then where the operator computes.
    """
    measured = projector.array(measured)
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

    In NumPy's array, wherever the operator computes.

    Parameters
    ----------
    measured : (pixels, columns) float32
    width, strength, iterations
        See `solve_smoothly`.
    start : (unknowns, columns) float32
    weights : (pixels, columns) float32, optional
    """
    start = projector.array(start)
    if not strength:
        return host(mlem_of_several(projector, measured, iterations=iterations, start=start))
    basis = GaussianBasis(projector, width) if width else None
    found = curvature_of_several(
        basis or projector,
        measured,
        strength=strength,
        iterations=iterations,
        start=_coefficients(basis, start) if basis else start,
        weights=weights,
    )
    return host(basis.to_voxels(found) if basis else found)


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

    ``width`` is the Gaussian basis' standard deviation in voxels, 0 for none; ``strength`` as of
    `tomo.solvers.curvature`; 0 is `tomo.solvers.mlem`, whatever the width. ``callback`` receives
    the volume itself, not the coefficients of the blobs.
    """
    if not strength:
        found = mlem(projector, measured, iterations=iterations, start=start, callback=callback)
        return replace(found, settings={**found.settings, "strength": 0.0, "smooth_width": 0.0})
    basis = GaussianBasis(projector, width) if width else None
    start = projector.array(start)

    def report(index: int, unknowns: NDArray[np.float32], residual: float) -> bool | None:
        volume = basis.to_voxels(unknowns) if basis else unknowns
        return None if callback is None else callback(index, volume, residual)

    found = curvature(
        basis or projector,
        measured,
        strength=strength,
        iterations=iterations,
        start=_coefficients(basis, start) if basis else start,
        weights=weights,
        callback=report if callback else None,
    )
    return replace(
        found,
        volume=basis.volume(found.volume) if basis else found.volume,
        settings={**found.settings, "smooth_width": width},
    )


def _coefficients(basis: GaussianBasis, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return coefficients ``z`` whose blobs come near a volume, ``G z = x``, in its shape.

    ``z <- z / (G 1) * G (x / G z)``, from ``z = x``: what `tomo.solvers.mlem` is for images, for a
    blur (Richardson, "Bayesian-based iterative method of image restoration", Journal of the
    Optical Society of America 62 (1972); Lucy, Astronomical Journal 79 (1974)).
    """
    found, xp = volume, namespace(volume)
    reach = 1 / xp.maximum(basis.to_voxels(xp.ones_like(volume)), SINGLE_PRECISION)
    for _ in range(UNBLURRED):
        seen = basis.to_voxels(found)
        missed = quotient(volume, seen)
        found = found * reach * basis.to_voxels(missed)
    least = factors(SINGLE_PRECISION * largest(found), found)
    return xp.where(found > least, found, 0.0)  # alike in all units of light
