"""The adjoint of pixels that are not finite: its integers can hold no NaN and no infinity."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def adjoint_with_nonfinite(
    adjoint: Callable[[NDArray], NDArray], y: NDArray, finite: NDArray[np.bool_]
) -> NDArray:
    """Return the adjoint of pixels ``y`` of which some are not ``finite``.

    Their values reach every voxel that they see; ``adjoint`` takes finite pixels only.
    """
    volume = adjoint(np.where(finite, y, 0))
    with np.errstate(invalid="ignore"):  # infinity less infinity is not a number
        for value in np.unique(y[~finite]):
            same = np.isnan(y) if np.isnan(value) else y == value
            volume[adjoint(same.astype(np.float64)) > 0] += value
    return volume
