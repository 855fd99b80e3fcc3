"""A scene in other units of length and intensity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo import LinearSystem, VoxelGrid
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.simulation.simulate import SimulatedImages

FACTORS = (1e-6, 3.7e-6, 2.9e5, 1e6)
RANGE = f"x {min(FACTORS):g} to {max(FACTORS):g}"
EXACT = 1e-5


@dataclass(frozen=True, eq=False)
class Scaled:
    """A scene in other units: lengths and intensities times a factor each."""

    original: SimulatedImages
    lengths: float = 1.0
    intensities: float = 1.0

    @property
    def name(self) -> str:
        """Both factors."""
        return f"lengths x {self.lengths:g}, intensities x {self.intensities:g}"

    @property
    def emission(self) -> float:
        """What a voxel's emission has to be multiplied by."""
        return self.intensities / self.lengths

    @cached_property
    def simulated(self) -> SimulatedImages:
        """The scan in these units."""
        grid = self.original.grid
        return replace(
            self.original,
            rig=scaled_rig(self.original.rig, self.lengths),
            grid=VoxelGrid(grid.shape, np.multiply(grid.spacing, self.lengths)),
            images=MappingProxyType(
                {n: _times(image, self.intensities) for n, image in self.original.images.items()}
            ),
            truth=_times(self.original.truth, self.emission),
        )

    @cached_property
    def system(self) -> LinearSystem:
        """The stored equations."""
        return LinearSystem.from_rig(self.simulated.rig, self.simulated.grid, form="stored")

    @cached_property
    def on_the_fly(self) -> OnTheFlyProjector:
        """The same equations, not stored."""
        rig, grid = self.simulated.rig, self.simulated.grid
        return OnTheFlyProjector(list(map(pixel_source, rig, self.system.pixels)), grid)

    @property
    def images(self) -> list[NDArray[np.float32]]:
        """In the rig's order."""
        return list(self.simulated.images.values())

    @cached_property
    def measured(self) -> NDArray[np.float32]:
        """The pixels of the equations."""
        return self.system.flatten(self.images)

    def unscaled(self, volume: NDArray) -> NDArray[np.float64]:
        """Return a volume in the original's unit."""
        return volume.astype(np.float64) / self.emission


def scaled_rig(rig: Rig, factor: float) -> Rig:
    """Return a rig with all its lengths times a factor: nothing but where cameras stand."""
    return replace(rig, cameras=tuple(replace(camera, t=camera.t * factor) for camera in rig))


def _times(array: NDArray, factor: float) -> NDArray[np.float32]:
    return (factor * array.astype(np.float64)).astype(np.float32)
