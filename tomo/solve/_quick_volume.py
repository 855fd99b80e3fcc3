"""A volume from some of the views, good enough to predict what the other views show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.solve._common_start import common_start
from tomo.solve.mlem import mlem
from tomo.viewed import ViewedOperator


def quick_volume(
    projector: ViewedOperator,
    measured: NDArray[np.floating],
    views: Sequence[int],
    *,
    iterations: int,
    smears: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return a few iterations of MLEM from some of the views: the live voxels, ``(unknowns,)``.

    Parameters
    ----------
    projector : ViewedOperator
        Of all views.
    measured : (pixels,)
        Of all views.
    views : sequence of int
        Those that take part.
    iterations : int
    smears : (views, unknowns), optional
        See `tomo.solve._common_start.common_start`.
    """
    found = mlem(
        projector.subset(views),
        measured[projector.pixels_of(views)],
        iterations=iterations,
        start=common_start(projector, measured, views, smears),
    )
    return projector.live.compress(found.volume)
