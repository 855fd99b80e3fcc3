"""From the coefficients of the linear basis to the mean emission in every voxel, and back."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.ndimage
from numpy.typing import NDArray

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

    Parameters
    ----------
    coefficients : (nx, ny, nz)
        The emission at the voxels' centres.

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
