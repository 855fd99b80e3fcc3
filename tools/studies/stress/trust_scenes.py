"""Flames with noise, again and again: what the condition report is judged on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from studies.common.flames import PHOTONS, flame_rig, with_noise
from studies.common.scans import Problem, problem, simulated_by
from tomo import VoxelGrid
from tomo.selection import Choice, choose_by_left_out_pixels, solve_as_chosen
from tomo.simulation import simulate_images
from tomo.simulation.simulate import SimulatedImages
from tomo.uncertainty import Solve

FRACTION = 0.02
SHAPE, SPACING, SHRINK = (30, 140, 30), 0.5, 2


@dataclass(frozen=True, eq=False)
class TrustScene:
    """A flame, its images without noise, and one noisy set reconstructed by default."""

    name: str
    noise: str
    clean: SimulatedImages
    problem: Problem  # of the noisy images
    choice: Choice  # of the default method
    volume: NDArray[np.float32]  # (nx, ny, nz)
    seed: int  # of the noise of that set, and of the sets that `repeated` gives

    @property
    def solve(self) -> Solve:
        """The reconstruction of other pixels, with the same choice."""
        projector = self.problem.system.projector

        def solve(measured: NDArray[np.float32]) -> NDArray[np.float32]:
            volume = solve_as_chosen(projector, measured, self.choice).volume
            return projector.active.compress(volume)

        return solve

    @property
    def images(self) -> list[NDArray[np.float32]]:
        """The images without noise, in the rig's order."""
        return list(self.clean.images.values())

    def true_noise(self) -> NDArray[np.float64]:
        """Return the standard deviation of every pixel that takes part, ``(pixels,)``."""
        light = self.problem.system.flatten(self.images).astype(np.float64)
        brightest = max(float(image.max()) for image in self.images)
        if self.noise == "gaussian":
            return np.full(len(light), FRACTION * brightest)
        return np.sqrt(light * brightest / PHOTONS)

    def repeated(self, count: int, batch: int) -> NDArray[np.float64]:
        """Return the spread of the voxels over ``count`` new noisy sets, same choice."""
        volumes = [
            self.solve(self.problem.system.flatten(images))
            for images in self._noisy_sets(count, batch)
        ]
        return np.std(volumes, axis=0, ddof=1, dtype=np.float64)

    def _noisy_sets(self, count: int, batch: int) -> Iterator[list[NDArray[np.float32]]]:
        for number in range(count):
            yield with_noise(self.images, self.noise, (self.seed, batch, number), FRACTION)


def trust_scene(
    flame: str,
    views: int,
    noise: str,
    seed: int,
    shape: tuple[int, int, int] = SHAPE,
    spacing: float = SPACING,
    shrink: int = SHRINK,
) -> TrustScene:
    """Return a flame in the paper's box and one noisy set, reconstructed by default.

    ``gaussian`` is white noise of 2 % of the brightest pixel, ``poisson`` counts 1000 photons in
    it, ``clean`` is without. Images are taken with 3 x 3 rays a pixel through voxels half as wide.
    """
    clean = _clean(flame, views, seed, shape, spacing, shrink)
    return _by_default(f"{flame}, {views} views, {noise}", noise, clean, seed)


def seen_by(scene: TrustScene, rig: Rig) -> TrustScene:
    """Return the scene as other cameras see its truth, reconstructed by default."""
    grid, truth = scene.clean.grid, scene.clean.truth

    def field(points: NDArray) -> NDArray[np.float64]:
        inside = grid.voxel_of(points)
        return np.where(inside < 0, 0.0, truth.ravel()[inside])

    clean = simulate_images(rig, field, grid, supersample=2)
    return _by_default(scene.name, scene.noise, clean, scene.seed)


@lru_cache(maxsize=4)
def _clean(
    flame: str, views: int, seed: int, shape: tuple[int, int, int], spacing: float, shrink: int
) -> SimulatedImages:
    rig, grid = flame_rig(views, shrink), VoxelGrid(shape, spacing)
    return simulated_by(rig, grid, (flame, seed), supersample=3)


def _by_default(name: str, noise: str, clean: SimulatedImages, seed: int) -> TrustScene:
    images = with_noise(list(clean.images.values()), noise, (seed, 0, 0), FRACTION)
    equations = problem(clean.rig, clean.grid, images, skip=True)
    projector = equations.system.projector
    choice = choose_by_left_out_pixels(projector, equations.measured)
    volume = solve_as_chosen(projector, equations.measured, choice).volume
    return TrustScene(name, noise, clean, equations, choice, volume, seed)
