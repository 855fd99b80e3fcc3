"""The random homogeneous set: uncorrelated random values, statistically equal everywhere."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from phantoms.field import BoxField, as_points


@dataclass(frozen=True)
class RandomHomogeneous(BoxField):
    """Equal cells, each of one value drawn uniformly from 0 to 1; the outer layer is dark.

    The paper (arXiv 2010.00893) tests on a "random homogeneous" set without defining it. Here it
    is statistically homogeneous in space and constant within each cell: no structure helps a
    prior. Cells are 1 mm in the reference box, 2 x 2 x 2 voxels of 0.5 mm. The default grids hold
    the field exactly: the error of a reconstruction is the solver's, not the grid's.

    The field is discontinuous between cells: sampling on a grid that cuts cells converges at first
    order only. Cells are half-open, like voxels.

    Parameters
    ----------
    seed, extent, center
        As in :class:`BoxField`.
    cells : (int, int, int)
        Number of cells along x, y, z, the dark outer layer included; at least 3.
    """

    cells: tuple[int, int, int] = (15, 70, 15)
    _values: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw the cells' values."""
        super().__post_init__()
        cells = tuple(int(n) for n in self.cells)
        if len(cells) != 3 or cells != tuple(self.cells) or min(cells) < 3:
            raise ValueError(
                f"RandomHomogeneous cells: found {self.cells}, expected three whole numbers >= 3"
            )
        values = np.zeros(cells)
        inner = tuple(n - 2 for n in cells)
        values[1:-1, 1:-1, 1:-1] = np.random.default_rng(self.seed).random(inner)
        values.flags.writeable = False
        object.__setattr__(self, "cells", cells)
        object.__setattr__(self, "_values", values)

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the value ``(...)``, float64, of the cell that each of ``points`` is in."""
        position = self._in_extents(as_points(points)) + 0.5  # faces at 0 and 1
        index = np.floor(position * self.cells).astype(np.int64)
        inside = np.asarray(((index >= 0) & (index < self.cells)).all(axis=-1))
        index = np.where(inside[..., None], index, 0)  # cell 0 is dark
        return self._values[index[..., 0], index[..., 1], index[..., 2]]
