"""A projector whose unknowns are smooth blobs instead of boxes: the method of sieves.

Voxels finer than the cameras can resolve let a solver fit noise and calibration errors with
streaks. With a volume written as ``x = G z``, ``G`` a Gaussian blur, only volumes at least as
smooth as ``G`` exist; non-negative ``z`` gives non-negative ``x``. Any solver that works on
projections alone can run on it: it sees ``A G``, whose exact transpose is ``G A^T``.

Snyder and Miller, "The use of sieves to stabilize images produced with the EM algorithm for
emission tomography", IEEE Transactions on Nuclear Science 32 (1985).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse.linalg import LinearOperator

from tomo.projector import Projector


class SmoothBasis(LinearOperator):
    """The projector ``A G`` of Gaussian blobs at the voxel centres.

    Parameters
    ----------
    projector : Projector
        ``A``.
    width : float
        Standard deviation of the blobs in voxels; above zero.

    Notes
    -----
    The kernel is cut at three standard deviations and sums to one; outside the grid there is
    nothing, so ``G`` is symmetric and the adjoint is exact.
    """

    def __init__(self, projector: Projector, width: float) -> None:
        if not width > 0:
            raise ValueError(f"smooth basis width: found {width}, expected above 0 voxels")
        self.projector = projector
        self.width = float(width)
        self.grid = projector.grid
        self.view_ptr = projector.view_ptr
        super().__init__(dtype=projector.dtype, shape=projector.shape)

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return f"SmoothBasis({self.projector!r}, width={self.width})"

    def blur(self, coefficients: NDArray) -> NDArray:
        """Return the volume ``G z`` of coefficients ``z``; the shape stays."""
        volume = coefficients.reshape(self.grid.shape)
        blurred = gaussian_filter(volume, self.width, mode="constant", truncate=3.0)
        return blurred.reshape(coefficients.shape)

    def _matvec(self, x: NDArray) -> NDArray:
        return self.projector @ self.blur(x.ravel())

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self.blur(self.projector.T @ y.ravel())

    @property
    def n_views(self) -> int:
        """Number of views."""
        return self.projector.n_views

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Projection of coefficients that are all one, ``(pixels,)``."""
        return self @ np.ones(self.shape[1])

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """Back-projection of images that are all one, ``(voxels,)``."""
        return self.T @ np.ones(self.shape[0])

    def view(self, number: int) -> SmoothBasis:
        """Return the projector of one view."""
        return SmoothBasis(self.projector.view(number), self.width)

    def take(self, pixels: NDArray[np.integer]) -> SmoothBasis:
        """Return the projector of some pixels, given in ascending order; views stay views."""
        return SmoothBasis(self.projector.take(pixels), self.width)

    def subset(self, views: Sequence[int]) -> SmoothBasis:
        """Return the projector of some views, in the order given."""
        return SmoothBasis(self.projector.subset(views), self.width)
