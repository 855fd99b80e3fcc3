"""Light through absorbing gas: the fraction that arrives, and what more gas would change."""

from __future__ import annotations

from typing import cast

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
    *,
    extinction: NDArray[np.floating] | None = None,
    outside: NDArray[np.float64] | None = None,
) -> NDArray[np.floating]:
    """Return the fraction of the light of every segment that leaves the grid: ``(segments,)``.

    Parameters
    ----------
    segments : Segments
        The segments of ``rays``, with midpoints.
    rays : Rays
        Paths from the camera on; none of weight zero. The segments have one piece a row.
    grid : VoxelGrid
    absorption, self_absorption : float
        ``k`` in 1 / length and ``q`` in 1 / (emission * length).
    emission : (voxels,), optional
        ``E`` of every voxel number of the segments; needed where ``q`` is not zero.
    extinction : (voxels,), optional
        ``k_n`` of every voxel number of the segments, in 1 / length.
    outside : (pieces, 2), optional
        Optical depth of each piece before it enters the grid, and after it leaves it.

    Notes
    -----
    ``exp(-k d - sum_n (q E_n + k_n) l_n - (q E + k_s) l / 2)``: ``d`` is the way in the grid from
    the camera to the segment's midpoint; the sum is over the segments of the path before it, and
    half of the segment's own optical depth makes the integral along a ray accurate to second
    order in the voxel size.
    """
    box = enter_box(rays, grid)
    entry = box.position * grid.spacing - grid.extent / 2  # (pieces, 3)
    near = np.einsum("ij,ij->i", entry, rays.directions)
    nothing = np.zeros(0, np.float32)
    used = nothing
    if self_absorption != 0:
        used = cast("NDArray[np.floating]", emission).ravel()
    given = nothing if extinction is None else extinction
    beyond = np.zeros((0, 2)) if outside is None else outside
    paths = rays.paths
    through = np.zeros_like(segments.length)

    def transmit(first: int, last: int) -> None:
        _transmit(
            segments.ptr, segments.voxel, segments.length, segments.midpoint, rays.directions,
            rays.weight, near, box.length, used, given, beyond, float(absorption),
            float(self_absorption), paths, first, last, through,
        )  # fmt: skip

    run_ranges(len(paths) - 1, transmit)
    return through


def dimming(segments: Segments, rays: Rays, light: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the change of every ray by a unit of extinction in each segment: ``(segments,)``.

    Parameters
    ----------
    segments : Segments
        As of `transmission`.
    rays : Rays
    light : (segments,)
        What arrives of the light of every segment, times the ray's weight.

    Notes
    -----
    The derivative of ``sum_s I_s exp(-sum_n k_n l_n - k_s l_s / 2)`` by ``k_n`` is minus ``l_n``
    times the light that arrives from behind segment ``n``, with half of its own.
    """
    paths, change = rays.paths, np.zeros_like(segments.length)

    def dim(first: int, last: int) -> None:
        _dim(segments.ptr, segments.length, rays.weight, light, paths, first, last, change)

    run_ranges(len(paths) - 1, dim)
    return change


@compiled()
def _dim(ptr, length, weights, light, path_ptr, first, last, change):
    """Walk some paths towards the camera and add up the light from behind each segment."""
    for path in range(first, last):
        behind = 0.0
        for ray in range(path_ptr[path + 1] - 1, path_ptr[path] - 1, -1):
            for s in range(ptr[ray + 1] - 1, ptr[ray] - 1, -1):
                change[s] = -length[s] / weights[ray] * (behind + light[s] / 2)
                behind += light[s]


@compiled()
def _transmit(
    ptr, voxel, length, midpoint, directions, weights, near, inside, emission, extinction,
    outside, absorption, self_absorption, path_ptr, first, last, through,
):  # fmt: skip
    """Walk some paths from the camera on and add up the optical depth before each segment."""
    for path in range(first, last):
        before = 0.0
        for ray in range(path_ptr[path], path_ptr[path + 1]):
            dx, dy, dz = directions[ray]
            strength = self_absorption / weights[ray]  # lengths hold the weight already
            before += outside[ray, 0] if len(outside) > 0 else 0.0
            passed = before - absorption * near[ray]
            for s in range(ptr[ray], ptr[ray + 1]):
                along = dx * midpoint[s, 0] + dy * midpoint[s, 1] + dz * midpoint[s, 2]
                own = strength * emission[voxel[s]] * length[s] if len(emission) > 0 else 0.0
                if len(extinction) > 0:
                    own += extinction[voxel[s]] * length[s] / weights[ray]
                through[s] = np.exp(-(absorption * along + passed + own / 2))
                passed += own
            before = passed + absorption * (near[ray] + inside[ray])
            before += outside[ray, 1] if len(outside) > 0 else 0.0
