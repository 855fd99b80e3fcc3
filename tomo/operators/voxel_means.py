"""Between the coefficients of linear splines and the mean emission in every voxel."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.ndimage
from numpy.typing import NDArray

NEIGHBOUR = 1 / 8
"""Of the hat ``1 - |x|`` about a voxel's centre, ``integral 1/2 .. 1`` lies in each neighbour."""

TAPS = (NEIGHBOUR, 1 - 2 * NEIGHBOUR, NEIGHBOUR)

EDGES = "reflect"
"""What is beyond the grid is as its outermost voxel: a flame that leaves the grid goes on."""


def averages(coefficients: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the mean emission in every voxel.

    Of emission ``sum_j c_j hat(x - x_j) hat(y - y_j) hat(z - z_j)``, with hats as wide as two
    voxels: along each axis ``c_(j-1) / 8 + 3 c_j / 4 + c_(j+1) / 8``.

    Parameters
    ----------
    coefficients : (nx, ny, nz)
        The emission at the voxels' centres.

    Returns
    -------
    (nx, ny, nz)
        In the same type. Their sum is that of the coefficients.
    """
    volume = coefficients
    for axis in range(3):
        volume = scipy.ndimage.correlate1d(volume, TAPS, axis=axis, mode=EDGES)
    return volume


def coefficients_of(volume: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the coefficients whose `averages` are ``volume`` (nx, ny, nz).

    The taps are the quadratic B-spline at whole numbers, which makes this the direct transform of
    Unser, Aldroubi and Eden, "B-spline signal processing: part II", IEEE Transactions on Signal
    Processing 41 (1993), here solved for as it stands. Its matrix is symmetric.
    """
    found = np.asarray(volume, np.float64)
    for axis, count in enumerate(found.shape):
        if count == 1:  # both its neighbours are as it is
            continue
        bands = np.full((2, count), NEIGHBOUR)  # of the upper half: off the diagonal, and on it
        bands[1] = 1 - 2 * NEIGHBOUR
        bands[1, [0, -1]] += NEIGHBOUR
        lines = np.moveaxis(found, axis, 0)
        solved = scipy.linalg.solveh_banded(bands, lines.reshape(count, -1), check_finite=False)
        found = np.moveaxis(solved.reshape(lines.shape), 0, axis)
    return found
