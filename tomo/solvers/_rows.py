"""The rows of a stored matrix, each voxel once, for methods that go pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.trace.segments import merge


def merged_rows(
    projector: ProjectionOperator, method: str
) -> tuple[NDArray[np.int64], NDArray[np.integer], NDArray[np.floating]]:
    """Return ``ptr, voxel, length`` of the stored rows with each voxel at most once in each.

    Several rays of one pixel meet the same voxel and leave an entry each. Their sum is the matrix
    entry ``a_pv``; a method that takes ``||a_p||^2`` or ``max a_p`` of the parts instead steps too
    far, by a factor of the number of rays. Without repeats nothing is copied.
    """
    if projector.matrix is None:
        raise ValueError(
            f"projector: found one without a stored matrix, expected a stored one: {method} goes "
            "through stored rows on the CPU: use sart or smart, which take any operator"
        )
    segments = projector.segments
    given = segments.ptr, segments.voxel, segments.length
    ptr, voxel, length = (np.zeros_like(one) for one in given)
    last, done = np.full(projector.shape[1], -1), np.zeros(1, np.int64)
    merge(*given, last, done, ptr, voxel, length)
    return given if ptr[-1] == len(segments) else (ptr, voxel[: ptr[-1]], length[: ptr[-1]])
