"""Compiled loops along rays: the upstream emission and the parametric corrections."""

from __future__ import annotations

import numba
import numpy as np

from tomo._compute.jit import compiled


@compiled(parallel=True)
def upstream_emission(start, count, voxel, length, volume, unit, upstream) -> None:
    """Write the emission between the camera and each segment's middle to ``upstream`` (S,)."""
    for ray in numba.prange(len(start)):
        before = 0.0
        for s in range(start[ray], start[ray] + count[ray]):
            own = np.float64(length[s]) * np.float64(volume[voxel[s]])
            upstream[s] = (before + own / 2) / unit
            before += own


@compiled(parallel=True)
def parametric_corrections(
    start, count, view, depth, upstream, off_axis, coefficients, log_gain, correction
) -> None:
    """Write ``exp(coefficients . terms + log_gain) - 1`` to ``correction`` (S,)."""
    by_depth, by_upstream = np.float64(coefficients[0]), np.float64(coefficients[1])
    for ray in numba.prange(len(start)):
        own = np.float64(log_gain[view[ray]]) + np.float64(coefficients[2]) * off_axis[ray]
        for s in range(start[ray], start[ray] + count[ray]):
            correction[s] = np.expm1(by_depth * depth[s] + by_upstream * upstream[s] + own)
