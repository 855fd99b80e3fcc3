"""Light from outside the grid: bright lines of sight that miss its box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.hull.dark_votes import touched
from tomo.hull.projection_lattice import Lattice
from tomo.measurement import NoiseModel
from tomo.measurement.background import SIGMAS
from tomo.measurement.pixel_blocks import SIDE, blocks_of

if TYPE_CHECKING:
    from rigs import CameraLike

BRIGHT = 0.03  # fraction of the brightest block's mean, added to what noise makes
REACH = 0.02
"""Share of an image's longer side by which the box is grown: lenses blur, cameras look outside."""

CELLS = 16
"""Cells along each axis of the box: enough to find the pixels it touches through any lens."""


def light_outside(
    cameras: Sequence[CameraLike],
    images: Sequence[NDArray[np.floating]],
    masks: Sequence[NDArray[np.bool_]],
    noise: Sequence[NoiseModel],
    grid: VoxelGrid,
) -> list[float]:
    """Return the fraction of each image's light on lines of sight that miss the grid's box.

    Parameters
    ----------
    cameras : sequence of CameraLike
    images : sequence of (height, width)
    masks : sequence of (height, width) bool
        True where a pixel is usable.
    noise : sequence of NoiseModel
        One an image.
    grid : VoxelGrid

    Returns
    -------
    fractions : list of float
        0 to 1. It is 0 for a dark image, for one without the box, and where the camera's lens
        does not map all of the box.

    Notes
    -----
    Blocks of 4 x 4 usable pixels count where their mean is above five of its standard deviations
    and 3 % of the brightest block's.
    """
    box = VoxelGrid((CELLS,) * 3, tuple(grid.extent / CELLS), grid.center)
    lattices = Lattice.of_all(cameras, box)
    shapes = [image.shape for image in images]
    seen = touched(np.ones(box.shape, bool), lattices, shapes)
    return [
        _fraction_outside(np.asarray(image, np.float64), np.asarray(mask, bool), one, pixels)
        for image, mask, one, pixels in zip(images, masks, noise, seen, strict=True)
    ]


def _fraction_outside(
    image: NDArray[np.float64],
    usable: NDArray[np.bool_],
    noise: NoiseModel,
    seen: NDArray[np.bool_],
) -> float:
    """Return the fraction of an image's light in blocks that do not see the box."""
    import cv2

    if not seen.any() or seen.all():
        return 0.0
    reach = max(1, round(REACH * max(image.shape)))
    near = cv2.dilate(seen.astype(np.uint8), np.ones((2 * reach + 1,) * 2, np.uint8))
    whole = blocks_of(usable).all(axis=1)
    means = blocks_of(image)[whole].mean(axis=1)
    outside = ~blocks_of(near > 0)[whole].any(axis=1)
    least = SIGMAS / SIDE * np.sqrt(noise.variance(0.0)) + BRIGHT * means.max(initial=0.0)
    light = np.where(means > least, means, 0.0)
    total = light.sum()
    return float(light[outside].sum() / total) if total > 0 else 0.0
