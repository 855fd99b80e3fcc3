"""Points all over a box."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def box_points(lower: ArrayLike, upper: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return points evenly over a box, its faces included; of two a side, its corners.

    Parameters
    ----------
    lower, upper : (3,) array_like
        Opposite corners.
    count : int
        Points along each side.

    Returns
    -------
    (count ** 3, 3) float64
        Along z first, then y, then x.
    """
    axes = [np.linspace(low, high, count) for low, high in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
