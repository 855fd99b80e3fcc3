"""The projector of emission that runs straight between the centres of voxels."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from tomo.defocus import Defocused
from tomo.live_voxels import LiveVoxels
from tomo.splines.averages import averages, coefficients_of
from tomo.viewed import ViewedOperator


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
    def of_averages(self) -> ViewedOperator:
        """The projector of a volume of means: it finds the coefficients first."""
        return _OfAverages(self)


class _OfAverages(ViewedOperator):
    """``A B C``, ``C`` from means in voxels to coefficients: symmetric, its inverse local.

    Its live voxels are those of the splines and their neighbours, into which hats reach.
    """

    def __init__(self, splines: Splines) -> None:
        self.splines = splines
        live = splines.live
        if not live.all:
            live = LiveVoxels.from_mask(live.grid, scipy.ndimage.maximum_filter(live.mask, 3))
        pixels, _ = splines.shape
        super().__init__(pixels, splines.grid, splines.view_ptr, splines.dtype, live)

    @cached_property
    def row_sums(self) -> NDArray[np.float64]:
        """Length of every pixel's rays inside the grid, ``(pixels,)``."""
        return self.splines.row_sums

    @cached_property
    def column_sums(self) -> NDArray[np.float64]:
        """What all rays see of every live voxel, ``(voxels,)``; 0 is unseen."""
        return self.live.compress(averages(self._grid_of(self.splines, self.splines.column_sums)))

    @property
    def n_crossings(self) -> int:
        """How many crossings of rays with voxels there are."""
        return self.splines.n_crossings

    def _matvec(self, x: NDArray) -> NDArray:
        found = coefficients_of(self._grid_of(self, x.ravel())).astype(x.dtype)
        return self.splines @ self.splines.live.compress(found)

    def _rmatvec(self, y: NDArray) -> NDArray:
        seen = self._grid_of(self.splines, self.splines.T @ y.ravel())
        return self.live.compress(coefficients_of(seen)).astype(y.dtype)

    @staticmethod
    def _grid_of(operator: ViewedOperator, unknowns: NDArray) -> NDArray:
        return operator.live.expand(unknowns).reshape(operator.grid.shape)

    def rows(self, start: int, stop: int) -> _OfAverages:
        """Return the projector of pixels ``start:stop`` as one view."""
        return _OfAverages(self.splines.rows(start, stop))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> _OfAverages:
        return _OfAverages(self.splines._taken(pixels, view_ptr))
