"""Distance of every voxel from the nearest active one: empty space that rays can skip.

The metric is that of the chessboard, the largest difference along an axis: a ray that moves on by
``n`` slabs leaves its voxel by at most ``n`` along any axis. It takes two passes through the
volume (A. Rosenfeld and J. L. Pfaltz, "Distance functions on digital pictures", Pattern
Recognition 1, 1968).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

FARTHEST = 255
"""Largest distance, in voxels: larger ones count as this, so that a byte holds them."""


@compiled()
def _pass(distance, nearest) -> None:
    """Lower the distances (nx + 2, ny + 2, nz + 2) to one more than a neighbour's, both ways.

    The outermost layers stay as they are; ``nearest`` (nz + 2,) is a buffer.
    """
    nx, ny, nz = distance.shape[0] - 2, distance.shape[1] - 2, distance.shape[2] - 2
    for way in (1, -1):
        for i in range(nx):
            x = i + 1 if way > 0 else nx - i
            for j in range(ny):
                y = j + 1 if way > 0 else ny - j
                first, second = distance[x - way, y - 1], distance[x - way, y]
                third, fourth = distance[x - way, y + 1], distance[x, y - way]
                for z in range(nz + 2):
                    nearest[z] = min(min(first[z], second[z]), min(third[z], fourth[z]))
                own = distance[x, y]
                last = FARTHEST
                for k in range(nz):
                    z = k + 1 if way > 0 else nz - k
                    near = min(min(nearest[z - 1], nearest[z]), min(nearest[z + 1], last))
                    last = min(own[z], near + 1)
                    own[z] = last


def clearance(active: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the distance of every voxel from the nearest active one, up to `FARTHEST`.

    Parameters
    ----------
    active : (nx, ny, nz) bool

    Returns
    -------
    (nx, ny, nz) uint8
        Zero where a voxel is active.
    """
    distance = np.full([n + 2 for n in active.shape], FARTHEST, np.uint8)
    inner = distance[1:-1, 1:-1, 1:-1]
    inner[active] = 0
    _pass(distance, np.zeros(distance.shape[2], np.uint8))
    return np.ascontiguousarray(inner)
