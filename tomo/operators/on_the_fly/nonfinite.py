"""What pixels that are not finite do to an adjoint whose sums are of whole numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def spoiled(
    adjoint: Callable[[NDArray], NDArray], y: NDArray, finite: NDArray[np.bool_]
) -> NDArray:
    """Return the adjoint of pixels some of which are not finite: they reach what they see.

    Parameters
    ----------
    adjoint : callable
        Of finite pixels.
    y : (pixels,)
    finite : (pixels,) bool
        Which of them are.
    """
    volume = adjoint(np.where(finite, y, 0))
    with np.errstate(invalid="ignore"):  # infinity less infinity is not a number
        for value in np.unique(y[~finite]):
            same = np.isnan(y) if np.isnan(value) else y == value
            volume[adjoint(same.astype(np.float64)) > 0] += value
    return volume
