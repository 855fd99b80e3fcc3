"""How much of a segment's light reaches the camera through gas that absorbs."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compile import compiled
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.trace.box import enter_box


def transmission(
    segments: Segments,
    rays: Rays,
    grid: VoxelGrid,
    absorption: float,
    self_absorption: float,
    emission: NDArray[np.floating] | None,
) -> NDArray[np.float64]:
    """Return the share of the light of every segment that leaves the grid's box: ``(S,)``.

    ``exp(-k d - q (sum_n E_n l_n + E l / 2))``: ``d`` from the segment's midpoint to where the
    ray enters the box on the camera's side, the sum over the segments between, and half of the
    segment's own optical depth, so that the integral along a ray is of second order in the
    voxels' size.

    Parameters
    ----------
    segments : Segments
        One row a ray, ordered from the camera on, with midpoints and with chords as lengths.
    rays : Rays
        One ray a row, from the camera on.
    grid : VoxelGrid
    absorption, self_absorption : float
        ``k`` in 1 / length and ``q`` in 1 / (emission * length).
    emission : (voxels,), optional
        ``E`` of every voxel number of the segments; needed where ``q`` is not zero.
    """
    entry = enter_box(rays, grid).position * grid.spacing - grid.extent / 2  # (rays, 3)
    near = np.einsum("ij,ij->i", entry, rays.directions)
    used = np.zeros(0) if self_absorption == 0 else emission.ravel()
    through = np.zeros(len(segments))
    _transmit(
        segments.ptr, segments.voxel, segments.length, segments.midpoint,
        rays.directions, near, used, absorption, self_absorption, through,
    )  # fmt: skip
    return through


@compiled(parallel=True)
def _transmit(
    ptr, voxel, length, midpoint, directions, near, emission, absorption, self_absorption, through
):
    """Walk every ray from the camera on and add up what its light has to pass."""
    for ray in numba.prange(len(near)):
        passed = 0.0
        for s in range(ptr[ray], ptr[ray + 1]):
            along = -near[ray]
            for axis in range(3):
                along += directions[ray, axis] * midpoint[s, axis]
            own = self_absorption * emission[voxel[s]] * length[s] if len(emission) > 0 else 0.0
            through[s] = np.exp(-(absorption * along + passed + own / 2))
            passed += own
