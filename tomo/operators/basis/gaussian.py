"""Gaussian blobs at the voxel centres as basis functions: the method of sieves.

Voxels finer than the cameras can resolve let a solver fit noise and calibration errors with
streaks. With a volume written as ``x = G z``, ``G`` a Gaussian blur, only volumes at least as
smooth as ``G`` exist; non-negative ``z`` gives non-negative ``x``. Every solver that works on
projections alone can use it: it sees ``A G``, whose exact transpose is ``G A^T``.

Snyder and Miller, "The use of sieves to stabilize images produced with the EM algorithm for
emission tomography", IEEE Transactions on Nuclear Science 32 (1985).
"""

from __future__ import annotations

from numpy.typing import NDArray

from tomo._compute.arrays import is_numpy
from tomo.grid.blur import Blur
from tomo.operators.composition import BasisProjector
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import by_columns


class GaussianBasis(BasisProjector):
    """The projection ``A G`` of Gaussian blobs at the voxel centres.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    width : float
        Standard deviation of the blobs in voxels; above zero.
    blur : Blur, optional
        The blur of that width on the same voxels, where there is one already.

    Raises
    ------
    ValueError
        If the width is not above zero.

    Notes
    -----
    The kernel is cut at three standard deviations and sums to one. The emission is zero outside
    the grid and in voxels that are not active, so that ``G`` is symmetric and the adjoint exact;
    it passes the dot test to 1e-12 in float64.
    """

    def __init__(
        self, projector: ProjectionOperator, width: float, blur: Blur | None = None
    ) -> None:
        if not width > 0:
            raise ValueError(f"smooth basis width: found {width}, expected above 0 voxels")
        self.width = float(width)
        self._blur = Blur(projector.active, self.width) if blur is None else blur
        super().__init__(projector)

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return f"GaussianBasis({self.projector!r}, width={self.width})"

    def _on(self, projector: ProjectionOperator) -> GaussianBasis:
        return GaussianBasis(projector, self.width, self._blur)

    def to_voxels(self, coefficients: NDArray) -> NDArray:
        """Return the active voxels ``G z`` of coefficients ``z``; the shape stays."""
        if not is_numpy(coefficients):
            return self._blur(coefficients)
        if coefficients.ndim == 2:  # (unknowns, columns)
            return by_columns(self._blur, coefficients)
        return self._blur(coefficients.ravel()).reshape(coefficients.shape)

    def to_voxels_adjoint(self, values: NDArray) -> NDArray:
        """Return ``G^T v``, which is ``G v``: the kernel is symmetric."""
        return self.to_voxels(values)

    def volume(self, coefficients: NDArray) -> NDArray:
        """Return the volume of coefficients that cover the grid, as solvers return them."""
        blurred = self.active.expand(self.to_voxels(self.active.compress(coefficients)))
        return blurred.reshape(coefficients.shape)
