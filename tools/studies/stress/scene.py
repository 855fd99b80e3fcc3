"""The small scene that most areas share: a jet in view of a ring of cameras, and its way back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

import rigs
from rigs import Rig
from studies.common.scans import simulated_by
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.operators.operator import ProjectionOperator
from tomo.simulation.simulate import SimulatedImages
from tomo.solvers import Solution

SHAPE = (12, 28, 12)
SPACING = 0.5
ITERATIONS = 10
JET = ("jet", 1)
BY_PIXEL = ("art", "mart")
SMOOTHING = ("curvature", "tikhonov", "tv")
"""Methods whose penalty spreads light to neighbours, by design."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A rig, its grid, and what is seen there."""

    simulated: SimulatedImages
    system: LinearSystem
    on_the_fly: ProjectionOperator  # the same matrix as the system's
    measured: NDArray[np.float32]  # (pixels,)

    @property
    def stored(self) -> ProjectionOperator:
        """The system's matrix."""
        return self.system.projector

    @property
    def truth(self) -> NDArray[np.float32]:
        """The emission, of the grid's shape."""
        return self.simulated.truth

    @property
    def grid(self) -> VoxelGrid:
        """The voxels."""
        return self.simulated.grid

    def projectors(self, method: str) -> list[tuple[str, ProjectionOperator]]:
        """Return the forms of the matrix that a method can use, by name."""
        forms = [("stored", self.stored), ("on the fly", self.on_the_fly)]
        return forms[:1] if method in BY_PIXEL else forms

    def cases(self) -> list[tuple[str, str, ProjectionOperator]]:
        """Return every classic method with every form of the matrix: name, method, projector."""
        return [
            (f"{method}, {form}", method, projector)
            for method in solvers.METHODS
            for form, projector in self.projectors(method)
        ]


def ring(count: int = 9, **options: object) -> Rig:
    """Return so many cameras of 24 x 40 pixels round the scene, pitched up and down in turn."""
    return rigs.ring(
        count,
        distance=options.pop("distance", 300.0),
        image_size=options.pop("image_size", (24, 40)),
        footprint=options.pop("footprint", 0.4),
        pitch_degrees=[10.0 if n % 2 else -10.0 for n in range(count)],
        **options,
    )


@cache
def scene(noise: float = 0.0, cameras: int = 9) -> Scene:
    """Return the scene, simulated through finer voxels and 2 x 2 rays a pixel."""
    return scene_of(ring(cameras), noise)


def scene_of(rig: Rig, noise: float = 0.0, grid: VoxelGrid | None = None) -> Scene:
    """Return what a rig sees of the jet; the projectors have one ray a pixel."""
    return equations(jet_by(rig, grid, noise=noise))


def equations(simulated: SimulatedImages) -> Scene:
    """Return what is seen, in equations of one ray a pixel."""
    rig, grid = simulated.rig, simulated.grid
    system = LinearSystem.from_rig(rig, grid, form="stored")
    measured = system.flatten(list(simulated.images.values()))
    on_the_fly = OnTheFlyProjector(list(map(pixel_source, rig, system.pixels)), grid)
    return Scene(simulated, system, on_the_fly, measured)


def solved(
    method: str,
    projector: ProjectionOperator,
    measured: NDArray,
    iterations: int = ITERATIONS,
    **settings: object,
) -> Solution:
    """Return what one classic method makes of the images."""
    return getattr(solvers, method)(projector, measured, iterations=iterations, **settings)


def jet_by(rig: Rig, grid: VoxelGrid | None = None, **how: object) -> SimulatedImages:
    """Return what a rig sees of the jet, through finer voxels and 2 x 2 rays a pixel."""
    return simulated_by(rig, VoxelGrid(SHAPE, SPACING) if grid is None else grid, JET, **how)
