"""Held-out rays, excluded from the refinement, and their errors predicted from other views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.selfcal.refine.first_volume import first_volume
from tomo.selfcal.refine.moment import Moment, usable_in_all

EVERY = 5
"""One tile in this many is held out of each image. Fewer tiles make the comparison noisy; more
leave fewer rays for the refinement."""

TILES = 16
"""Tiles along an image's shorter side. More, held-out rays have training rays next to them; fewer,
their scatter is uncertain."""

GROUPS = 4
"""Interleaved groups in which more than six views are left out; up to six are left out singly.
More groups take longer; fewer predict each view from too few others."""

SIGNIFICANT = 0.5
"""Standard errors, over tiles, by which the squared error of held-out rays must fall. Higher, real
improvements are refused, since errors of the volume scatter more than those of a camera; lower,
chance is accepted."""

SURE_ELSEWHERE = 2.0
"""The same where other moments judge than those that cameras were refined from. Lower, chance is
accepted, which reached 1.6 with exact cameras; higher, films keep poses 0.4 pixels wrong (2.6)."""

WORTH_IT = 0.02
WORTH_ALL_CAMERAS = 0.05
"""Fraction by which the squared error of held-out rays must fall: at least, and where all cameras
move. Lower, exact cameras are moved by chance; higher, pose errors of 0.2 pixels stay."""


def held_out_tiles(shapes: Sequence[tuple[int, int]]) -> list[NDArray[np.bool_]]:
    """Return the held-out pixels of each image: tiles on diagonals, shifted from view to view."""
    found = []
    for view, shape in enumerate(shapes):
        rows, columns = np.indices(shape) // _side(shape)
        found.append((rows + 2 * columns + view) % EVERY == 0)
    return found


def training_pixels(moments: Sequence[Moment]) -> list[NDArray[np.bool_]]:
    """Return the pixels that are usable at every moment and not held out, one image a camera."""
    masks = usable_in_all(moments)
    tiles = held_out_tiles([mask.shape for mask in masks])
    return [mask & ~held for mask, held in zip(masks, tiles, strict=True)]


@dataclass(frozen=True, eq=False)
class HeldOutErrors:
    """The errors of held-out rays predicted from other views.

    Attributes
    ----------
    squared_errors : (views, tiles) float64
        Sum of the squared errors in each tile.
    light : float
        Sum of the squared held-out pixels.
    """

    squared_errors: NDArray[np.float64]
    light: float

    @property
    def relative_error(self) -> float:
        """Square root of the squared errors over the light; NaN for dark images."""
        return float(np.sqrt(self.squared_errors.sum() / self.light)) if self.light else np.nan

    def is_improved_by(
        self, other: HeldOutErrors, moved: float = 1.0, significant: float = SIGNIFICANT
    ) -> bool:
        """Whether the other errors are smaller by more than chance.

        ``moved`` is the fraction of the cameras that were refined: the improvement expected by
        chance grows with it. ``significant`` is how many standard errors count.
        """
        gains = (self.squared_errors - other.squared_errors).ravel()
        worth = max(WORTH_ALL_CAMERAS * moved, WORTH_IT)
        if other.squared_errors.sum() > (1 - worth) * self.squared_errors.sum():
            return False
        scatter = float(np.sqrt(np.sum(np.square(gains - gains.mean()))))
        return bool(gains.sum() > significant * scatter)


def predict_held_out(
    rig: Rig, moments: Sequence[Moment], grid: VoxelGrid, active: ActiveVoxels
) -> HeldOutErrors:
    """Predict the held-out rays of left-out views from the training rays of the other views.

    The prediction of a view is scaled by the gain that fits its training rays best, so that a
    brighter camera is not taken for a displaced one. The errors are summed over the moments.

    Parameters
    ----------
    rig : Rig
    moments : sequence of Moment
        Pixels count that are usable at all of them.
    grid : VoxelGrid
    active : ActiveVoxels
    """
    masks, training = usable_in_all(moments), training_pixels(moments)
    # pixels whose rays miss the volume count as predicted dark
    system = LinearSystem.from_rig(rig, grid, masks=masks, active=active)
    trained = system.flatten([each.astype(np.float32) for each in training]).astype(bool)
    pointer, views = system.projector.view_ptr, len(rig)
    groups = views if views <= 6 else GROUPS
    errors, light = np.zeros((views, 0)), 0.0
    for group in range(groups):
        left_out = range(group, views, groups)
        chosen = trained.copy()
        for view in left_out:
            chosen[pointer[view] : pointer[view + 1]] = False
        rays = np.flatnonzero(chosen)
        projector = system.projector.take(rays)
        for moment in moments:
            measured = system.flatten(moment.images)
            volume = first_volume(projector, measured[rays])
            reprojected = system.images(system.projector @ volume.values)
            for view in left_out:
                image, held = moment.images[view], masks[view] & ~training[view]
                gain = _gain(reprojected[view][training[view]], image[training[view]])
                residual = np.where(held, image - gain * reprojected[view], 0).astype(np.float64)
                sums = _by_tile(residual**2)
                if errors.shape[1] < len(sums):
                    errors = np.pad(errors, ((0, 0), (0, len(sums) - errors.shape[1])))
                errors[view, : len(sums)] += sums
                light += float(np.sum(np.square(image[held], dtype=np.float64)))
    return HeldOutErrors(errors, light)


def tiles_of(shape: tuple[int, int], count: int = TILES) -> NDArray[np.int64]:
    """Return the tile number of each pixel, ``(rows, columns)``."""
    side = _side(shape, count)
    rows, columns = np.indices(shape) // side
    return rows * (shape[1] // side + 1) + columns


def _side(shape: tuple[int, int], count: int = TILES) -> int:
    """Return the side of a tile in pixels."""
    return max(min(shape) // count, 2)


def _by_tile(values: NDArray[np.float64]) -> NDArray[np.float64]:
    height, width = values.shape
    return np.bincount(tiles_of((height, width)).ravel(), values.ravel()).astype(
        np.float64, copy=False
    )


def _gain(predicted: NDArray, measured: NDArray) -> float:
    energy = float(np.sum(np.square(predicted, dtype=np.float64)))
    product = float(np.sum(np.multiply(predicted, measured, dtype=np.float64)))
    return product / energy if energy > 0 and product > 0 else 1.0
