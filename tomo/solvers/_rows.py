"""The rows of a stored matrix, each voxel once, for methods that go pixel by pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.operators.operator import ProjectionOperator


@compiled()
def _merged_counts(ptr, voxel, last_row, row_ptr):
    """Count the different voxels of every row."""
    for row in range(len(ptr) - 1):
        count = 0
        for slot in range(ptr[row], ptr[row + 1]):
            if last_row[voxel[slot]] != row:
                last_row[voxel[slot]] = row
                count += 1
        row_ptr[row + 1] = row_ptr[row] + count


@compiled()
def _merge(ptr, voxel, length, row_ptr, place, merged_voxel, merged_length):
    """Add up the entries of each row that belong to one voxel, in order of first occurrence."""
    for row in range(len(ptr) - 1):
        end = row_ptr[row]
        for slot in range(ptr[row], ptr[row + 1]):
            v = voxel[slot]
            if place[v] < row_ptr[row]:
                place[v] = end
                merged_voxel[end] = v
                end += 1
            merged_length[place[v]] += length[slot]


def merged_rows(
    projector: ProjectionOperator, method: str
) -> tuple[NDArray[np.int64], NDArray[np.integer], NDArray[np.floating]]:
    """Return ``ptr, voxel, length`` of the rows with each voxel at most once in each.

    Several rays of one pixel meet the same voxel and leave an entry each. Their sum is the matrix
    entry ``a_pv``; a method that takes ``||a_p||^2`` or ``max a_p`` of the parts instead steps too
    far, by a factor of the number of rays. Without repeats nothing is copied.

    Raises
    ------
    ValueError
        If the projector stores no matrix.
    """
    if projector.matrix is None:
        raise ValueError(
            f"projector: found one without a stored matrix, expected a stored one: {method} goes "
            "through stored rows on the CPU: use sart or smart, which take any operator"
        )
    segments, n_voxels = projector.segments, projector.shape[1]
    row_ptr = np.zeros_like(segments.ptr)
    _merged_counts(segments.ptr, segments.voxel, np.full(n_voxels, -1), row_ptr)
    if row_ptr[-1] == len(segments):
        return segments.ptr, segments.voxel, segments.length
    voxel = np.zeros(row_ptr[-1], segments.voxel.dtype)
    length = np.zeros(row_ptr[-1], segments.length.dtype)
    place = np.full(n_voxels, -1)
    _merge(segments.ptr, segments.voxel, segments.length, row_ptr, place, voxel, length)
    return row_ptr, voxel, length
