"""Basis functions other than voxels: hats, linear between voxel centres, and Gaussian blobs."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.ndimage
from numpy.typing import NDArray

from tomo._compute.arrays import is_numpy
from tomo.grid import ActiveVoxels
from tomo.grid.blur import Blur
from tomo.operators.composition import BasisProjector
from tomo.operators.operator import LINEAR, ProjectionOperator
from tomo.operators.vectors import by_columns

NEIGHBOUR = 1 / 8
"""Fraction of the hat ``1 - |x|`` around a voxel's centre in each neighbour: its integral from 1/2
to 1."""

TAPS = (NEIGHBOUR, 1 - 2 * NEIGHBOUR, NEIGHBOUR)

EDGES = "reflect"
"""Beyond the grid the emission continues as in its outermost voxel: flames may leave the grid."""


def voxel_means(coefficients: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the mean emission in every voxel of coefficients of the linear basis.

    The emission is ``sum_j c_j hat(x - x_j) hat(y - y_j) hat(z - z_j)``; hats are two voxels
    wide. The mean along each axis is ``c_(j-1) / 8 + 3 c_j / 4 + c_(j+1) / 8``.

    ``coefficients`` (nx, ny, nz) are the emission at the voxels' centres.

    Returns
    -------
    (nx, ny, nz)
        In the same type; the sum is that of the coefficients.
    """
    volume = coefficients
    for axis in range(3):
        volume = scipy.ndimage.correlate1d(volume, TAPS, axis=axis, mode=EDGES)
    return volume


def coefficients_of(volume: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the coefficients whose `voxel_means` are ``volume`` (nx, ny, nz).

    The taps are the quadratic B-spline at whole numbers, which makes this the direct B-spline
    transform, here solved as a banded system along each axis. Its matrix is symmetric.

    References
    ----------
    Unser, Aldroubi and Eden, "B-spline signal processing: part II", IEEE Transactions on Signal
    Processing 41 (1993).
    """
    found = np.asarray(volume, np.float64)
    for axis, count in enumerate(found.shape):
        if count == 1:  # both neighbours are equal to it
            continue
        bands = np.full((2, count), NEIGHBOUR)  # upper half: off the diagonal, on it
        bands[1] = 1 - 2 * NEIGHBOUR
        bands[1, [0, -1]] += NEIGHBOUR
        lines = np.moveaxis(found, axis, 0)
        solved = scipy.linalg.solveh_banded(bands, lines.reshape(count, -1), check_finite=False)
        found = np.moveaxis(solved.reshape(lines.shape), 0, axis)
    return found


class LinearBasis(BasisProjector):
    """The projection of emission that is linear along each axis between voxel centres.

    The unknowns are the emission at the voxel centres, coefficients of linear B-splines (hats).
    `voxel_means` are the mean emission of every voxel, and `on_voxel_means` projects those.

    Parameters
    ----------
    projector : ProjectionOperator
        ``B A``: the voxel basis ``A``, seen through the blur ``B`` of a voxel's footprint
        (`tomo.operators.footprint_blur`).

    Notes
    -----
    A hat is a voxel blurred by a voxel, ``hat = box * box``, and the projection of a blurred
    volume is a blurred projection. The operator is therefore ``B A``, with ``B`` the image-space
    footprint of a voxel at the grid's centre: an approximation, which `footprint_kernel` fits.
    Pixels finer than voxels show edges of the voxel basis that the emission does not have, a few
    per cent of the light, and solvers make up for them by contrast; this basis has none.

    Forward ``B (A x)``, adjoint ``A^T (B^T y)``; they pass the dot test to 1e-12 in float64.

    Examples
    --------
    >>> A = LinearBasis(footprint_blur(rig, pixels, seen, grid) @ rays)    # doctest: +SKIP
    """

    basis = LINEAR

    def __repr__(self) -> str:
        """Name the operator of the voxel basis."""
        return f"<LinearBasis: {self.shape[0]} pixels of {self.without_blur!r}>"

    def _on(self, projector: ProjectionOperator) -> LinearBasis:
        return LinearBasis(projector)

    @property
    def without_blur(self) -> ProjectionOperator:
        """``A``, the operator of the voxel basis."""
        return self.projector.without_blur

    def voxel_means(self, volume: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the mean emission in every voxel of coefficients, both ``(nx, ny, nz)``."""
        return voxel_means(volume)

    @cached_property
    def on_voxel_means(self) -> ProjectionOperator:
        """The operator ``B A C`` of a volume of voxel means."""
        active = self.active
        if not active.all:
            mask = scipy.ndimage.maximum_filter(active.mask, 3)
            active = ActiveVoxels.from_mask(active.grid, mask)
        return OnVoxelMeans(self, active)


class OnVoxelMeans(BasisProjector):
    """The operator ``B A C`` that takes voxel means to images by the linear basis ``B A``.

    ``C``, from voxel means to coefficients (`coefficients_of`), is symmetric, its inverse local.
    Active are the basis' voxels and their neighbours, into which hats reach. It is computed on the
    CPU, wherever the linear basis is: products are NumPy's arrays.
    """

    array, takes = ProjectionOperator.array, ProjectionOperator.takes
    computing = ProjectionOperator.computing

    def _on(self, projector: ProjectionOperator) -> OnVoxelMeans:
        return OnVoxelMeans(projector, self.active)

    def to_voxels(self, coefficients: NDArray) -> NDArray:
        """Return the coefficients of voxel means."""
        return by_columns(self._coefficients, coefficients)

    def _coefficients(self, means: NDArray) -> NDArray:
        found = coefficients_of(_on_grid(self, means)).astype(means.dtype)
        return self.projector.active.compress(found)

    def to_voxels_adjoint(self, unknowns: NDArray) -> NDArray:
        """Return ``C^T x``."""
        return by_columns(self._means_adjoint, unknowns)

    def _means_adjoint(self, unknowns: NDArray) -> NDArray:
        found = coefficients_of(_on_grid(self.projector, unknowns))
        return self.active.compress(found).astype(unknowns.dtype)

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Sum of every row, ``(pixels,)``: means of one are coefficients of one."""
        return self.projector.row_sums

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """Light that all pixels see of every active voxel, ``(voxels,)``; 0 is unseen."""
        sums = _on_grid(self.projector, self.projector.column_sums)
        return self.active.compress(voxel_means(sums))


def _on_grid(operator: ProjectionOperator, unknowns: NDArray) -> NDArray:
    return operator.active.expand(unknowns).reshape(operator.grid.shape)


class GaussianBasis(BasisProjector):
    """The projection ``A G`` of Gaussian blobs at the voxel centres: the method of sieves.

    Voxels finer than the cameras can resolve let a solver fit noise and calibration errors with
    streaks. With a volume written as ``x = G z``, ``G`` a Gaussian blur, only volumes at least as
    smooth as ``G`` exist; non-negative ``z`` gives non-negative ``x``.

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

    References
    ----------
    Snyder and Miller, "The use of sieves to stabilize images produced with the EM algorithm for
    emission tomography", IEEE Transactions on Nuclear Science 32 (1985).
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
