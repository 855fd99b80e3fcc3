"""A projector whose unknowns are smooth blobs instead of boxes: the method of sieves.

Voxels finer than the cameras can resolve let a solver fit noise and calibration errors with
streaks. With a volume written as ``x = G z``, ``G`` a Gaussian blur, only volumes at least as
smooth as ``G`` exist; non-negative ``z`` gives non-negative ``x``. Any solver that works on
projections alone can run on it: it sees ``A G``, whose exact transpose is ``G A^T``.

Snyder and Miller, "The use of sieves to stabilize images produced with the EM algorithm for
emission tomography", IEEE Transactions on Nuclear Science 32 (1985).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.grid.blur import Blur
from tomo.operators.operator import ProjectionOperator


class GaussianBasis(ProjectionOperator):
    """The projector ``A G`` of Gaussian blobs at the voxel centres.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    width : float
        Standard deviation of the blobs in voxels; above zero.
    blur : Blur, optional
        Of that width on the same voxels, where there is one already.

    Notes
    -----
    The kernel is cut at three standard deviations and sums to one; outside the grid, and in
    voxels that are not active, there is nothing, so ``G`` is symmetric and the adjoint is exact.
    """

    def __init__(
        self, projector: ProjectionOperator, width: float, blur: Blur | None = None
    ) -> None:
        if not width > 0:
            raise ValueError(f"smooth basis width: found {width}, expected above 0 voxels")
        self.projector = projector
        self.width = float(width)
        self._blur = Blur(projector.active, self.width) if blur is None else blur
        super().__init__(
            projector.shape[0],
            projector.grid,
            projector.view_ptr,
            projector.dtype,
            projector.active,
        )

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return f"GaussianBasis({self.projector!r}, width={self.width})"

    def blur(self, coefficients: NDArray) -> NDArray:
        """Return the active voxels ``G z`` of coefficients ``z``; the shape stays."""
        return self._blur(coefficients.ravel()).reshape(coefficients.shape)

    def volume(self, coefficients: NDArray) -> NDArray:
        """Return the volume of coefficients that cover the grid, as solvers return them."""
        blurred = self.active.expand(self.blur(self.active.compress(coefficients)))
        return blurred.reshape(coefficients.shape)

    def _matvec(self, x: NDArray) -> NDArray:
        return self.projector @ self.blur(x.ravel())

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self.blur(self.projector.T @ y.ravel())

    @property
    def n_segments(self) -> int:
        """How many crossings of rays with voxels there are."""
        return self.projector.n_segments

    def rows(self, start: int, stop: int) -> GaussianBasis:
        """Return the projector of pixels ``start:stop`` as one view."""
        return GaussianBasis(self.projector.rows(start, stop), self.width, self._blur)

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> GaussianBasis:
        return GaussianBasis(self.projector._taken(pixels, view_ptr), self.width, self._blur)
