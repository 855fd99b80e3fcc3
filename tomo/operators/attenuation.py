"""The fraction of each segment's light that reaches the camera through absorbing gas."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import run_ranges
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.rays.ray_box import enter_box
from tomo.trace import Segments


def transmission(
    segments: Segments,
    rays: Rays,
    grid: VoxelGrid,
    absorption: float,
    self_absorption: float,
    emission: NDArray[np.floating] | None,
) -> NDArray[np.floating]:
    """Return the fraction of the light of every segment that leaves the grid: ``(segments,)``.

    Parameters
    ----------
    segments : Segments
        The segments of ``rays``, with midpoints.
    rays : Rays
        One ray a row, from the camera on; none of weight zero.
    grid : VoxelGrid
    absorption, self_absorption : float
        ``k`` in 1 / length and ``q`` in 1 / (emission * length).
    emission : (voxels,), optional
        ``E`` of every voxel number of the segments; needed where ``q`` is not zero.

    Notes
    -----
    ``exp(-k d - q (sum_n E_n l_n + E l / 2))``: ``d`` is the distance from the segment's midpoint
    to the point where the ray enters the grid on the camera's side; the sum is over the segments
    between, and half of the segment's own optical depth makes the integral along a ray accurate
    to second order in the voxel size.
    """
    entry = enter_box(rays, grid).position * grid.spacing - grid.extent / 2  # (rays, 3)
    near = np.einsum("ij,ij->i", entry, rays.directions)
    used = np.zeros(0, np.float32) if self_absorption == 0 else emission.ravel()
    through = np.zeros_like(segments.length)

    def transmit(first: int, last: int) -> None:
        _transmit(
            segments.ptr, segments.voxel, segments.length, segments.midpoint, rays.directions,
            rays.weight, near, used, float(absorption), float(self_absorption), first, last,
            through,
        )  # fmt: skip

    run_ranges(len(rays), transmit)
    return through


@compiled()
def _transmit(
    ptr, voxel, length, midpoint, directions, weights, near, emission,
    absorption, self_absorption, first, last, through,
):  # fmt: skip
    """Walk some rays from the camera on and add up the optical depth before each segment."""
    for ray in range(first, last):
        dx, dy, dz = directions[ray]
        strength = self_absorption / weights[ray]  # lengths hold the weight already
        passed = -absorption * near[ray]
        for s in range(ptr[ray], ptr[ray + 1]):
            along = dx * midpoint[s, 0] + dy * midpoint[s, 1] + dz * midpoint[s, 2]
            own = strength * emission[voxel[s]] * length[s] if len(emission) > 0 else 0.0
            through[s] = np.exp(-(absorption * along + passed + own / 2))
            passed += own
