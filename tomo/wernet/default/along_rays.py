"""What changes along rays, for every segment: the emission in front, and what dims with it."""

from __future__ import annotations

import numba
import numpy as np

from tomo._compute.jit import compiled


@compiled(parallel=True)
def emission_in_front(start, count, voxel, length, volume, unit, front) -> None:
    """Write to ``front`` (S,) the emission between each segment's middle and the camera."""
    for ray in numba.prange(len(start)):
        before = 0.0
        for s in range(start[ray], start[ray] + count[ray]):
            own = np.float64(length[s]) * np.float64(volume[voxel[s]])
            front[s] = (before + own / 2) / unit
            before += own


@compiled(parallel=True)
def trend_corrections(
    start, count, view, depth, front, off_axis, trend, level, correction
) -> None:
    """Write to ``correction`` (S,) what trends (3,) along the rays and levels (views,) make."""
    by_depth, by_front = np.float64(trend[0]), np.float64(trend[1])
    for ray in numba.prange(len(start)):
        own = np.float64(level[view[ray]]) + np.float64(trend[2]) * off_axis[ray]
        for s in range(start[ray], start[ray] + count[ray]):
            correction[s] = np.expm1(by_depth * depth[s] + by_front * front[s] + own)
