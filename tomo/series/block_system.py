"""The equations that the frames of a block share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.pipeline.build import WeightedSystem


@dataclass(frozen=True, eq=False)
class BlockSystem:
    """The equations that the frames of a block share.

    Attributes
    ----------
    built : WeightedSystem
        Those of the cameras that take part; its pixels are those of one frame.
    apart : LinearSystem, optional
        Those of the cameras that take no part, in the same basis, through the same gas.
    active : ActiveVoxels
        The voxels that any frame of the block may light.
    pixels : tuple of (height, width) bool
        The pixels that were asked for, one image a camera.
    """

    built: WeightedSystem
    apart: LinearSystem | None
    active: ActiveVoxels
    pixels: tuple[NDArray[np.bool_], ...]
