"""The projector of emission that runs straight between the centres of voxels."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.operators.image_blur import Defocused
from tomo.operators.operator import ProjectionOperator
from tomo.operators.voxel_means import averages, coefficients_of


class Splines(Defocused):
    """The projector of linear splines: chords ``A`` through boxes, blurred by their shadows ``B``.

    Its unknowns are the emission at the voxels' centres; between them it runs straight along each
    axis. `averages` are the mean emission in every voxel, and `of_averages` projects those. A
    flame is no pile of boxes: pixels finer than voxels see the edges of boxes where there are
    none, a few per cent of the light, and solvers make up for the boxes' width by contrast.

    Parameters
    ----------
    lines, spread, view_ptr
        As of `Defocused`; ``spread`` is a `shadow_spread`.
    """

    faint = 1e-4
    edged = False

    def __repr__(self) -> str:
        """Name the lines."""
        return f"<Splines: {self.shape[0]} pixels of {self.lines!r}>"

    def averages(self, volume: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the mean emission in every voxel, of coefficients ``(nx, ny, nz)``."""
        return averages(volume)

    @cached_property
    def of_averages(self) -> ProjectionOperator:
        """The projector of a volume of means: it finds the coefficients first."""
        return _OfAverages(self)


class _OfAverages(ProjectionOperator):
    """``A B C``, ``C`` from means in voxels to coefficients: symmetric, its inverse local.

    Its active voxels are those of the splines and their neighbours, into which hats reach.
    """

    def __init__(self, splines: Splines) -> None:
        self.splines = splines
        active = splines.active
        if not active.all:
            active = ActiveVoxels.from_mask(
                active.grid, scipy.ndimage.maximum_filter(active.mask, 3)
            )
        pixels, _ = splines.shape
        super().__init__(pixels, splines.grid, splines.view_ptr, splines.dtype, active)

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Length of every pixel's rays inside the grid, ``(pixels,)``."""
        return self.splines.row_sums

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """What all rays see of every active voxel, ``(voxels,)``; 0 is unseen."""
        return self.active.compress(
            averages(self._grid_of(self.splines, self.splines.column_sums))
        )

    @property
    def n_segments(self) -> int:
        """How many crossings of rays with voxels there are."""
        return self.splines.n_segments

    def _matvec(self, x: NDArray) -> NDArray:
        found = coefficients_of(self._grid_of(self, x.ravel())).astype(x.dtype)
        return self.splines @ self.splines.active.compress(found)

    def _rmatvec(self, y: NDArray) -> NDArray:
        seen = self._grid_of(self.splines, self.splines.T @ y.ravel())
        return self.active.compress(coefficients_of(seen)).astype(y.dtype)

    @staticmethod
    def _grid_of(operator: ProjectionOperator, unknowns: NDArray) -> NDArray:
        return operator.active.expand(unknowns).reshape(operator.grid.shape)

    def rows(self, start: int, stop: int) -> _OfAverages:
        """Return the projector of pixels ``start:stop`` as one view."""
        return _OfAverages(self.splines.rows(start, stop))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> _OfAverages:
        return _OfAverages(self.splines._taken(pixels, view_ptr))
