"""A volume from some of the views, good enough to predict what the other views show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.solvers.initial_volume import common_start
from tomo.solvers.mlem import mlem


def quick_volume(
    projector: ProjectionOperator,
    measured: NDArray[np.floating],
    views: Sequence[int],
    *,
    iterations: int,
    smears: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return a few iterations of MLEM from some of the views: the active voxels, ``(unknowns,)``.

    Parameters
    ----------
    projector : ProjectionOperator
        Of all views.
    measured : (pixels,)
        Of all views.
    views : sequence of int
        Those that take part.
    iterations : int
    smears : (views, unknowns), optional
        See `tomo.solvers.initial_volume.common_start`.
    """
    found = mlem(
        projector.subset(views),
        measured[projector.pixels_of(views)],
        iterations=iterations,
        start=common_start(projector, measured, views, smears),
    )
    return projector.active.compress(found.volume)
