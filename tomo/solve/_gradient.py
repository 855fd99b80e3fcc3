"""Differences of neighbouring voxels, and their exact transpose."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compile import compiled
from tomo._threads import threads_worth
from tomo.live_voxels import LiveVoxels

NANOSECONDS_FORWARD, NANOSECONDS_ADJOINT = 1.2, 3.0  # a voxel of the box, on one thread


@compiled(inline=True)
def difference(volume, i, j, k, factors):
    """Return the scaled forward differences at a voxel; zero across the grid's upper faces."""
    here = volume[i, j, k]
    x = factors[0] * (volume[i + 1, j, k] - here) if i + 1 < volume.shape[0] else np.float32(0)
    y = factors[1] * (volume[i, j + 1, k] - here) if j + 1 < volume.shape[1] else np.float32(0)
    z = factors[2] * (volume[i, j, k + 1] - here) if k + 1 < volume.shape[2] else np.float32(0)
    return x, y, z


@compiled(inline=True)
def divergence(field, i, j, k, factors):
    """Return ``(D^T p)`` at a voxel: minus the divergence, by backward differences."""
    nx, ny, nz = field.shape[0], field.shape[1], field.shape[2]
    total = np.float32(0)
    if i + 1 < nx:
        total -= factors[0] * field[i, j, k, 0]
    if j + 1 < ny:
        total -= factors[1] * field[i, j, k, 1]
    if k + 1 < nz:
        total -= factors[2] * field[i, j, k, 2]
    if i > 0:
        total += factors[0] * field[i - 1, j, k, 0]
    if j > 0:
        total += factors[1] * field[i, j - 1, k, 1]
    if k > 0:
        total += factors[2] * field[i, j, k - 1, 2]
    return total


@compiled(parallel=True)
def _forward(volume, factors, field):
    for plane in numba.prange(volume.shape[0]):
        i = np.int64(plane)
        for j in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                x, y, z = difference(volume, i, j, k, factors)
                field[i, j, k, 0] = x
                field[i, j, k, 1] = y
                field[i, j, k, 2] = z


@compiled(parallel=True)
def _adjoint(field, factors, volume):
    for plane in numba.prange(volume.shape[0]):
        i = np.int64(plane)
        for j in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                volume[i, j, k] = divergence(field, i, j, k, factors)


class Gradient:
    """The forward differences ``D`` of a volume that is zero where no voxel is live.

    Component ``a`` at a voxel is ``(x[v + e_a] - x[v]) h / h_a``, with ``h`` the geometric mean of
    the spacings: for cubes the plain difference of neighbours. Across the outer faces of the grid
    there is no difference, since nothing is known of what lies beyond; a voxel inside the grid
    that is not live is known to be zero, and differences to it count.

    Parameters
    ----------
    live : LiveVoxels

    Notes
    -----
    Fields cover the box around the live voxels, one layer of zeros included where the grid goes
    on, instead of the whole grid.
    """

    def __init__(self, live: LiveVoxels) -> None:
        self.live = live
        spacing = np.asarray(live.grid.spacing, np.float64)
        self.factors = (np.prod(spacing) ** (1 / 3) / spacing).astype(np.float32)  # (3,)
        self.shape = live.box.grid.shape

    def place(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the unknowns in the box, zero where none is: ``(bx, by, bz)``, a copy."""
        return self.live.box.expand(values.astype(np.float32)).reshape(self.shape)

    def pick(self, box: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the unknowns ``(n,)`` of values in the box."""
        return self.live.box.compress(box)

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D x`` of the unknowns ``x (n,)``: ``(bx, by, bz, 3)``."""
        field = np.zeros((*self.shape, 3), np.float32)
        volume = self.place(values)
        with threads_worth(NANOSECONDS_FORWARD * volume.size):
            _forward(volume, self.factors, field)
        return field

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T p (n,)`` of a field with as many values as `forward` returns."""
        volume = np.zeros(self.shape, np.float32)
        with threads_worth(NANOSECONDS_ADJOINT * volume.size):
            _adjoint(field.reshape(*self.shape, 3), self.factors, volume)
        return self.pick(volume)
