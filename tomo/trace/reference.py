"""The oracle: Siddon's algorithm, one ray at a time, in float64.

Siddon, "Fast calculation of the exact radiological path for a three-dimensional CT array",
Medical Physics 12 (1985), equations 2 to 13: cut the ray at every plane between voxels, sort the
cuts, and look up the voxel at the middle of each piece.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.segments import Segments
from tomo.trace._collect import collect_by_pixel
from tomo.trace.box import enter_box


def cut_ray(
    position: NDArray[np.float64],
    direction: NDArray[np.float64],
    length: float,
    shape: tuple[int, int, int],
) -> NDArray[np.float64]:
    """Return where a ray is cut, from 0 to ``length``: the sorted distances ``(cuts,)``."""
    cuts = [np.array([0.0, length])]
    for axis in range(3):
        if direction[axis] == 0:
            continue
        with np.errstate(over="ignore"):
            at_planes = (np.arange(1, shape[axis]) - position[axis]) / direction[axis]
        cuts.append(at_planes[(at_planes > 0) & (at_planes < length)])
    return np.unique(np.concatenate(cuts))


def trace(
    rays: Rays, grid: VoxelGrid, *, midpoints: bool = False, dtype: DTypeLike = np.float32
) -> Segments:
    """Trace rays the slow way; see `tomo.trace.trace`."""
    box = enter_box(rays, grid)
    counts, lengths, middles = [], [], []
    for position, direction, length in zip(box.position, box.direction, box.length, strict=True):
        if length == 0:
            counts.append(0)
            continue
        cuts = cut_ray(position, direction, length, grid.shape)
        middle = (cuts[:-1] + cuts[1:]) / 2
        counts.append(len(middle))
        lengths.append(np.diff(cuts))
        middles.append(position + direction * middle[:, None])  # (segments, 3), voxel units
    return collect_by_pixel(
        rays,
        grid,
        np.array(counts, np.int64),
        np.concatenate([np.zeros(0), *lengths]),
        np.concatenate([np.zeros((0, 3)), *middles]),
        midpoints=midpoints,
        dtype=dtype,
    )
