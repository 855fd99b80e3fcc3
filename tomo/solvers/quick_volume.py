"""A volume from some of the views, good enough to predict the other views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem


def quick_volume(
    projector: ProjectionOperator,
    measured: NDArray[np.floating],
    views: Sequence[int],
    *,
    iterations: int,
    back_projections: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return a few iterations of MLEM from some of the views: the active voxels, ``(unknowns,)``.

    Parameters
    ----------
    projector : ProjectionOperator
        The operator of all views.
    measured : (pixels,)
        The pixels of all views.
    views : sequence of int
        The views that take part.
    iterations : int
    back_projections : (views, unknowns), optional
        The result of `tomo.solvers.initial_volume.log_back_projections`.
    """
    found = mlem(
        projector.subset(views),
        measured[projector.pixels_of(views)],
        iterations=iterations,
        start=mlos_start(projector, measured, views, back_projections),
    )
    return projector.active.compress(found.volume)
