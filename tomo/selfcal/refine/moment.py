"""The images of one moment: what all cameras saw at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.scan.downsample import Coarser


@dataclass(frozen=True, eq=False)
class Moment:
    """The images of one moment, one a camera of the rig.

    Attributes
    ----------
    images : sequence of (height, width) float32
    masks : sequence of (height, width) bool
        True where a pixel is usable.
    """

    images: Sequence[NDArray[np.float32]]
    masks: Sequence[NDArray[np.bool_]]

    @classmethod
    def of(
        cls, images: Sequence[NDArray], masks: Sequence[NDArray[np.bool_]] | None = None
    ) -> Self:
        """Return the moment of some images; every finite pixel is usable without masks."""
        masks = [np.isfinite(image) for image in images] if masks is None else masks
        return cls(tuple(images), tuple(masks))

    @property
    def brightest(self) -> float:
        """The brightest usable pixel, at least 0."""
        both = zip(self.images, self.masks, strict=True)
        return max(float(np.max(image, initial=0, where=mask)) for image, mask in both)

    def coarser(self, rig: Rig, grid: VoxelGrid, factor: int) -> Self:
        """Return the same with larger pixels, see `tomo.scan.downsample.Coarser`."""
        found = Coarser.of(rig, self.images, self.masks, grid, factor)
        return type(self)(found.images, found.masks)


def usable_in_all(moments: Sequence[Moment]) -> list[NDArray[np.bool_]]:
    """Return the pixels that are usable at every moment, one image a camera."""
    each_camera = zip(*(moment.masks for moment in moments), strict=True)
    return [np.logical_and.reduce(masks) for masks in each_camera]
