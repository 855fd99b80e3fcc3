"""One entry for each voxel of a pixel, where several of its rays cross the same voxels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tomo._compute.jit import compiled
from tomo.rays import Rays
from tomo.trace.segments import Segments


def merging(tracer: Callable[[Rays], Segments], voxels: int) -> Callable[[Rays], Segments]:
    """Return the tracer whose lengths of a pixel in the same voxel are added up.

    Rays over an aperture cross few voxels that their neighbours do not: the matrix has a fraction
    of their segments. A pixel's voxels come in the order in which its rays first meet them.

    Parameters
    ----------
    tracer : callable
        From `tomo.trace.tracing`, without midpoints, which differ from ray to ray.
    voxels : int
        Above every voxel number that it gives.
    """
    last, done = np.full(voxels, -1), np.zeros(1, np.int64)

    def trace(rays: Rays) -> Segments:
        every = tracer(rays)
        ptr = np.zeros_like(every.ptr)
        voxel, length = np.zeros_like(every.voxel), np.zeros(len(every))
        _merge(every.ptr, every.voxel, every.length, last, done, ptr, voxel, length)
        kept = int(ptr[-1])
        return Segments(ptr, voxel[:kept].copy(), length[:kept].astype(every.length.dtype))

    return trace


@compiled()
def _merge(ptr, voxel, length, last, done, merged_ptr, merged_voxel, merged_length) -> None:
    """Write the merged entries.

    ``last`` (voxels,) holds the number of the last entry of each voxel, from ``done[0]`` on those
    of this call; below: of none.
    """
    first = end = done[0]
    for pixel in range(len(ptr) - 1):
        begin = end
        for s in range(ptr[pixel], ptr[pixel + 1]):
            entry = last[voxel[s]]
            if entry < begin:
                entry = end
                last[voxel[s]] = entry
                merged_voxel[entry - first] = voxel[s]
                end += 1
            merged_length[entry - first] += length[s]
        merged_ptr[pixel + 1] = end - first
    done[0] = end
