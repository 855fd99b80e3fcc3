"""The equations that the frames of a block share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.pipeline.build import WeightedSystem
from tomo.pipeline.evaluate import pixels_in_sight
from tomo.scan.images import Masks


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

    def changed(self, change: Callable[[LinearSystem], LinearSystem]) -> BlockSystem:
        """Return the same equations, both kinds of them changed alike."""
        built = replace(self.built, system=change(self.built.system))
        return replace(self, built=built, apart=self.apart and change(self.apart))

    @cached_property
    def in_sight(self) -> tuple[Masks, Masks]:
        """The pixels that may see the grid, of cameras that take part and of those that do not."""
        apart = [] if self.apart is None else pixels_in_sight(self.apart)
        return pixels_in_sight(self.built.system), apart
