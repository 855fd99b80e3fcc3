"""Rays that no refinement sees, and how well they are predicted from other views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.selfcal.refine.first_volume import first_volume

EVERY = 5
"""One of so many tiles of each image is held out."""

TILES = 16
"""Along an image's shorter side."""

GROUPS = 4
"""Up to six views are left out one at a time, more in so many interleaved groups."""

SIGNIFICANT = 0.5
"""Standard errors, from tile to tile, by which the held-out rays' squared error must fall: little,
since what a volume from few views lacks scatters more than what any camera does."""

WORTH_IT = 0.02
WORTH_ALL_CAMERAS = 0.05
"""And the share of it by which it must fall, at least and where all cameras move. By chance the
best of all rounds is 3 % better, of cameras that are right too: a tenth of a pixel puts edges
elsewhere between the voxels, and where a volume has got to when it is stopped makes two thirds of
a percent, by the last bits of a processor's sums. Poses wrong by 0.16 to 0.24 pixel make 7 to
13 %."""


def held_out_tiles(shapes: Sequence[tuple[int, int]]) -> list[NDArray[np.bool_]]:
    """Return which pixels of each image are held out: tiles on diagonals, shifted by view."""
    found = []
    for view, shape in enumerate(shapes):
        rows, columns = np.indices(shape) // _side(shape)
        found.append((rows + 2 * columns + view) % EVERY == 0)
    return found


@dataclass(frozen=True, eq=False)
class Judgement:
    """How well held-out rays are predicted.

    Attributes
    ----------
    squared_errors : (views, tiles) float64
        Summed over the tiles of each view.
    light : float
        The held-out pixels' sum of squares.
    """

    squared_errors: NDArray[np.float64]
    light: float

    @property
    def relative_error(self) -> float:
        """Root of all squared errors over the light; NaN if that is zero."""
        return float(np.sqrt(self.squared_errors.sum() / self.light)) if self.light else np.nan

    def is_improved_by(self, other: Judgement, moved: float = 1.0) -> bool:
        """Whether the other's errors are smaller by more than chance, tile by tile.

        ``moved`` is the share of the cameras that are not where they were: others bring nothing
        by chance.
        """
        gained = (self.squared_errors - other.squared_errors).ravel()
        worth = max(WORTH_ALL_CAMERAS * moved, WORTH_IT)
        if other.squared_errors.sum() > (1 - worth) * self.squared_errors.sum():
            return False
        scatter = float(np.sqrt(np.sum(np.square(gained - gained.mean()))))
        return bool(gained.sum() > SIGNIFICANT * scatter)


def judge(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    active: ActiveVoxels,
) -> Judgement:
    """Predict the held-out rays of views left out, from the other rays of the others.

    A view's prediction is scaled by the gain that fits its other rays best: a brighter camera is
    not one that looks elsewhere.
    """
    held = held_out_tiles([image.shape for image in images])
    # the pixels that a rig's rays through the volume miss count as predicted dark
    system = LinearSystem.from_rig(rig, grid, masks=masks, active=active)
    measured = system.flatten(images)
    trains = ~system.flatten([own.astype(np.float32) for own in held]).astype(bool)
    pointer, views = system.projector.view_ptr, len(rig)
    groups = views if views <= 6 else GROUPS
    errors, light = np.zeros((views, 0)), 0.0
    for group in range(groups):
        left_out = range(group, views, groups)
        chosen = trains.copy()
        for view in left_out:
            chosen[pointer[view] : pointer[view + 1]] = False
        rays = np.flatnonzero(chosen)
        volume = first_volume(system.projector.take(rays), measured[rays])
        seen = system.images(system.projector @ volume.values)
        for view in left_out:
            image, mask, own = images[view], masks[view], held[view]
            gain = _gain(seen[view][mask & ~own], image[mask & ~own])
            residual = np.where(mask & own, image - gain * seen[view], 0).astype(np.float64)
            sums = _by_tile(residual**2)
            if errors.shape[1] < len(sums):
                errors = np.pad(errors, ((0, 0), (0, len(sums) - errors.shape[1])))
            errors[view, : len(sums)] = sums
            light += float(np.sum(np.square(image[mask & own], dtype=np.float64)))
    return Judgement(errors, light)


def tiles_of(shape: tuple[int, int], count: int = TILES) -> NDArray[np.int64]:
    """Return the number of the tile that each pixel is in, of the image's shape."""
    side = _side(shape, count)
    rows, columns = np.indices(shape) // side
    return rows * (shape[1] // side + 1) + columns


def _side(shape: tuple[int, int], count: int = TILES) -> int:
    """Return a tile's, in pixels, of an image."""
    return max(min(shape) // count, 2)


def _by_tile(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.bincount(tiles_of(values.shape).ravel(), values.ravel())


def _gain(predicted: NDArray, measured: NDArray) -> float:
    energy = float(np.sum(np.square(predicted, dtype=np.float64)))
    product = float(np.sum(np.multiply(predicted, measured, dtype=np.float64)))
    return product / energy if energy > 0 and product > 0 else 1.0
