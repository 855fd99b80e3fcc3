"""A volume seen from anywhere: its maximum or its integral along the line of sight of each pixel.

The page's library draws no volumes. The server follows the lines of sight and sends a picture,
which stands behind everything else in the page.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import VoxelGrid

MAXIMUM, INTEGRAL = "maximum", "line integrals"


def seen_along(
    data: NDArray[np.float32], grid: VoxelGrid, viewpoint: Viewpoint, how: str, step: float = 1.0
) -> NDArray[np.float32]:
    """Return what each pixel of a viewpoint sees of a volume, ``(height, width)``.

    Parameters
    ----------
    data : (nx, ny, nz) float32
    grid : VoxelGrid
    viewpoint : Viewpoint
    how : {"maximum", "line integrals"}
        The largest value on the line of sight, or the integral along it.
    step : float
        Between two samples, in the smallest side of a voxel.

    Raises
    ------
    ValueError
        If the volume's shape is not the grid's.

    Notes
    -----
    Samples are interpolated linearly between voxel centres, and constant from the outermost
    centres to the faces. The integral is the sum of samples times their distance.
    """
    if data.shape != grid.shape:
        raise ValueError(f"volume: found shape {data.shape}, expected the grid's {grid.shape}")
    width, height = viewpoint.size
    uv = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    directions = viewpoint.directions(uv)
    eye = (viewpoint.eye - grid.origin) / grid.spacing
    out = np.zeros(len(uv), np.float32)
    length = step * float(np.min(grid.spacing))
    volume = np.ascontiguousarray(data, np.float32)
    _follow(volume, eye, directions / grid.spacing, length, how == MAXIMUM, out)
    return out.reshape(height, width)


@compiled(inline=True)
def _between(volume, x, y, z):
    """Return the value at a point, in voxels from the first one's centre."""
    nx, ny, nz = volume.shape
    x = min(max(x, 0.0), nx - 1.0)
    y = min(max(y, 0.0), ny - 1.0)
    z = min(max(z, 0.0), nz - 1.0)
    i, j, k = int(x), int(y), int(z)
    i2, j2, k2 = min(i + 1, nx - 1), min(j + 1, ny - 1), min(k + 1, nz - 1)
    a, b, c = np.float32(x - i), np.float32(y - j), np.float32(z - k)
    low = volume[i, j, k] + c * (volume[i, j, k2] - volume[i, j, k])
    high = volume[i, j2, k] + c * (volume[i, j2, k2] - volume[i, j2, k])
    near = low + b * (high - low)
    low = volume[i2, j, k] + c * (volume[i2, j, k2] - volume[i2, j, k])
    high = volume[i2, j2, k] + c * (volume[i2, j2, k2] - volume[i2, j2, k])
    return near + a * (low + b * (high - low) - near)


@compiled(parallel=True)
def _follow(volume, eye, directions, step, is_maximum, out):
    """Fill ``out`` with what rays see; eye and directions are in voxels, ``step`` a length."""
    for ray in numba.prange(len(out)):
        first, last = 0.0, np.inf
        for axis in range(3):
            d, low, high = directions[ray, axis], -0.5, volume.shape[axis] - 0.5
            if d == 0.0:
                if not low <= eye[axis] <= high:
                    last = -1.0
            else:
                one, other = (low - eye[axis]) / d, (high - eye[axis]) / d
                first, last = max(first, min(one, other)), min(last, max(one, other))
        if last <= first:
            continue
        count = int(np.ceil((last - first) / step))
        own = (last - first) / count
        seen, total = np.float32(0.0), 0.0
        for sample in range(count):
            at = first + (sample + 0.5) * own
            value = _between(
                volume,
                eye[0] + at * directions[ray, 0],
                eye[1] + at * directions[ray, 1],
                eye[2] + at * directions[ray, 2],
            )
            seen = max(seen, value)
            total += value
        out[ray] = seen if is_maximum else total * own
