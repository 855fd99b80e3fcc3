"""The image blur of a lens out of focus: the light of a point falls on a disc."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo.grid import VoxelGrid
from tomo.operators.image_blur import ImageBlur, Kernel

POINTS_A_PIXEL = 32
POINTS_A_DISC = 256
"""Sampling points along the side of a pixel, and at most along the disc: fewer misjudge the pixels
at the disc's edge, more take time."""

BOX = 4 / 3
"""Squared diameter of a disc over the squared side of the box of equal variance: a disc has the
variance ``d² / 16`` along an axis, a box ``h² / 12``."""


def lens_blur(
    rig: Rig, pixels: Sequence[NDArray[np.integer]], grid: VoxelGrid, diameter: float
) -> ImageBlur:
    """Return the blur of lenses whose images of a point in the volume are discs.

    ``pixels`` are each camera's flat numbers ``row * width + column`` that take part; the rays of
    others count as dark. ``diameter`` is that of the disc at the grid's centre, in the rig's
    length unit, taken to be the same at all depths, which is true of volumes far smaller than
    their distance. A voxel blurs its own projection like a box: the disc is smaller by as much.

    ValueError: the diameter is not a number above 0, the grid's centre is behind a camera, or a
    disc is larger than its image.
    """
    if not (math.isfinite(diameter) and diameter > 0):
        raise ValueError(f"blur: found {diameter}, expected a diameter above 0")
    of_voxel = BOX * float(np.mean(np.square(grid.spacing)))
    width = math.sqrt(max(diameter**2 - of_voxel, 0.0))
    sizes = rig.footprint(grid.center)
    kernels = [_kernel_of(camera, size, width) for camera, size in zip(rig, sizes, strict=True)]
    return ImageBlur.from_kernels(rig, pixels, kernels)


def _kernel_of(camera: CameraLike, size: float, width: float) -> Kernel:
    """Return the kernel of a disc of ``width`` where a pixel of the camera covers ``size``."""
    if not size > 0:
        raise ValueError(
            f"blur: camera {camera.name}: found the grid's centre behind it, expected it ahead"
        )
    if width > size * max(camera.image_size):
        raise ValueError(
            f"blur: camera {camera.name}: found a disc of {width / size:.0f} pixels, expected one "
            f"within its image of {camera.image_size[0]} x {camera.image_size[1]}"
        )
    return disc_kernel(width / size)


def disc_kernel(width: float) -> Kernel:
    """Return the pixels that a disc around a pixel's centre covers, and its fraction in each.

    ``width`` is its diameter in pixels; at 0 all light stays in the pixel.
    """
    reach = math.ceil(width / 2 - 0.5) if width > 1 else 0
    across = min(POINTS_A_PIXEL, max(POINTS_A_DISC // (2 * reach + 1), 1))
    points = (np.arange((2 * reach + 1) * across) + 0.5) / across - 0.5 - reach  # from its centre
    inside = np.square(points)[:, None] + np.square(points) <= (max(width, 1e-9) / 2) ** 2
    cells = inside.reshape(2 * reach + 1, across, 2 * reach + 1, across).sum(axis=(1, 3))
    if not cells.any():  # narrower than the points are apart
        cells[reach, reach] = 1
    rows, columns = np.nonzero(cells)
    weight = cells[rows, columns] / cells.sum()
    return np.stack([columns, rows], axis=1) - reach, weight.astype(np.float32)
