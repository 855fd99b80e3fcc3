"""Lines of sight against each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def nearest_point(
    positions: NDArray[np.float64], directions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the point with the least sum of squared distances to lines.

    The normal equations are ``sum_i (I - d_i d_i^T) (x - p_i) = 0``, solved about the mean
    position, so that parallel lines give a point beside the cameras.

    Parameters
    ----------
    positions : (N, 3) float64
        A point on each line.
    directions : (N, 3) float64
        Unit vectors along them.

    Returns
    -------
    point : (3,) float64
        That of least distance from the mean position where it is not unique.
    certainty : float
        The smallest eigenvalue of the equations: 0 for parallel lines, at most ``2 N / 3``.
    """
    middle = positions.mean(axis=0)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]  # (N, 3, 3)
    right = (across @ (positions - middle)[:, :, None]).sum(axis=0)[:, 0]
    offset, _, _, singular_values = np.linalg.lstsq(across.sum(axis=0), right, rcond=1e-9)
    return middle + offset, float(singular_values[-1])
