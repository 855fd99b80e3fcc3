"""Light from outside the grid: coarse voxels around it, as far as a grid's width away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem

CELLS = 6
"""Voxels around the grid along a length of each of its edges. More: light of noise; fewer: steps
between them show in the images."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Coarse voxels in a box twice as wide as the grid, without the grid itself."""

    grid: VoxelGrid
    active: ActiveVoxels

    @classmethod
    def of(cls, grid: VoxelGrid) -> Surroundings:
        """Return the surroundings of a grid."""
        size = 2 * CELLS
        middle, half = (grid.lower + grid.upper) / 2, np.asarray(grid.extent)
        box = VoxelGrid.from_bounds((size,) * 3, middle - half, middle + half)
        around = np.ones(box.shape, bool)
        inner = slice(CELLS // 2, CELLS // 2 + CELLS)
        around[inner, inner, inner] = False
        return cls(box, ActiveVoxels.from_mask(box, around))

    def equations(self, system: LinearSystem) -> LinearSystem:
        """Return the equations of the same pixels as a system's, of the voxels around."""
        seen = system.images(np.ones(system.projector.shape[0], np.float32))
        masks = [image > 0 for image in seen]
        return LinearSystem.from_rig(
            system.rig, self.grid, masks=masks, active=self.active, skip=False, form="stored"
        )
