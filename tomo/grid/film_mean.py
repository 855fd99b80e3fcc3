"""Mean and RMS of the fluctuation of every voxel over a film, in one pass."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tomo.grid.volume import Volume


def mean_and_rms(volumes: Iterable[NDArray]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean of every voxel over a film, and the RMS of its fluctuation.

    Parameters
    ----------
    volumes : iterable of (nx, ny, nz)
        One is needed at a time, as `tomo.SeriesStore.volumes` gives them.

    Returns
    -------
    mean, rms : (nx, ny, nz) float64
        Each a `Volume` where the frames are.

    Raises
    ------
    ValueError
        If there is no frame, or volumes are on different grids.

    Notes
    -----
    Welford's update in float64: ``d = x - m; m += d / n; s += d (x - m)``, and the RMS is
    ``sqrt(s / n)``. It loses no digits where the fluctuation is small against the mean.

    B. P. Welford, "Note on a method for calculating corrected sums of squares and products",
    Technometrics 4 (1962), 419-420.

    Examples
    --------
    >>> mean, rms = mean_and_rms([np.full((1, 1, 1), value) for value in (1.0, 3.0)])
    >>> mean.item(), rms.item()
    (2.0, 1.0)
    """
    number, mean, squares = 0, np.zeros(0), np.zeros(0)
    for number, volume in enumerate(volumes, 1):
        if number == 1:
            mean, squares = np.zeros(volume.shape), np.zeros(volume.shape)
            if isinstance(volume, Volume):  # whose arithmetic refuses other grids
                mean, squares = volume.like(mean), volume.like(squares)
        difference = volume - mean
        mean += difference / number
        difference *= volume - mean
        squares += difference
    if not number:
        raise ValueError("volumes: found none, expected one or more")
    rms = np.sqrt(squares / number)
    return mean, mean.like(rms) if isinstance(mean, Volume) else rms
