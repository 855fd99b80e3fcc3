"""The likelihood of images as photon counts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import as_type, is_numpy, like, namespace, quotient
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import beside, damped

BARELY_SEEN = 0.01
"""Fraction of the median column sum below which the update of a voxel is damped. Lower lets a
voxel that rays graze grow on their noise, higher slows voxels at the rim of the views."""


class Poisson:
    """The negative log-likelihood of pixels ``b`` as Poisson counts of mean ``A x``.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    measured : (pixels,) or (pixels, columns) float32
        ``b``; pixels below zero count as zero.
    fair : (unknowns,) float64 or 0
        Column sums that those of ``A`` count as at least, see `sensitivity`.

    Notes
    -----
    ``L(x) = sum_p (A x)_p - b_p log (A x)_p``, whose gradient is ``A^T 1 - A^T (b / A x)``. It
    falls at every update ``x <- x f`` by the `factor` ``f = A^T (b / A x) / A^T 1`` of
    expectation maximisation.
    """

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        fair: NDArray[np.float64] | float = 0.0,
    ) -> None:
        self.projector = projector
        self.counts = namespace(measured).maximum(measured, 0.0)
        parts = sensitivity(projector.column_sums, fair)
        self._per_column, self._missing = (like(one, measured) for one in parts)

    def factor(self, projected: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the factor of every unknown, ``(unknowns,)``, at ``A x``, ``(pixels,)``.

        Of each column where the images have columns.
        """
        seen = self.projector.T @ ratio(self.counts, projected)
        return beside(self._per_column, seen) * (seen + beside(self._missing, seen))

    def step(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the diagonal metric ``C = x / A^T 1`` of the update, ``(unknowns,)``.

        The update is a step along the gradient in it: ``x f = x - C (A^T 1 - A^T (b / A x))``.
        """
        return as_type(x * self._per_column, np.float32)


def ratio(measured: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return ``measured / projected``, and 1 (no change) where nothing is projected.

    In double precision: the faint tail of a flame, 1e-40, would overflow a single.
    """
    if is_numpy(measured):
        one = np.ones(measured.shape)
        return np.divide(measured, projected, out=one, where=projected > 0, dtype=np.float64)
    return quotient(as_type(measured, np.float64), as_type(projected, np.float64), 1.0)


def sensitivity(
    column_sums: NDArray[np.float64], fair: NDArray[np.float64] | float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the reciprocal divisor of an update and the length that it lacks: (unknowns,) each.

    A voxel that rays barely graze could grow without bound on noise that it has next to no part
    in. The length ``m`` that it lacks to a hundredth of the median voxel's is treated as seen by
    rays that agree with it: ``x (A^T ratio + m) / (A^T 1 + m)``, which leaves every fixed point
    and every well-seen voxel as it is. The same holds for a voxel with few rays in a subset: the
    length that it lacks there to the ``fair`` fraction of all subsets is taken to agree, or the
    noise of the one ray that grazes it would be all of its update. A voxel that no ray meets keeps
    its value.
    """
    missing = np.maximum(damped(column_sums, BARELY_SEEN), fair) - column_sums
    return 1 / (column_sums + missing), missing
