"""Random rigs, voxels and volumes: what a finite pixel does, without a scene to remember."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import phantoms
import rigs
from tomo import LinearSystem, Projector, VoxelGrid
from tomo.simulate import simulate

FOOTPRINTS = 0.3, 1.5
"""The range of a pixel's size, in mean voxel edges."""

MOST_UNEQUAL = 2.0
"""How many times longer than the mean a voxel's edge may be, or shorter."""


@dataclass(frozen=True, eq=False)
class Exercise:
    """Images of finite pixels, and the true voxels.

    Attributes
    ----------
    projector : Projector
        Of chords, one ray a pixel, with midpoints.
    measured : (pixels,) float32
    volume : (unknowns,) float32
        The truth.
    """

    projector: Projector
    measured: NDArray[np.float32]
    volume: NDArray[np.float32]


def random_exercise(
    random: np.random.Generator,
    *,
    shape: int = 14,
    views: int = 8,
    footprint: float | None = None,
) -> Exercise:
    """Return an exercise whose rig, voxels and emission are drawn at random.

    Parameters
    ----------
    random : numpy.random.Generator
    shape : int
        Voxels along an edge, give or take a third.
    views : int
        Cameras, give or take a half.
    footprint : float, optional
        A pixel's size in mean voxel edges; drawn from `FOOTPRINTS` when None.
    """
    counts = random.integers(max(shape * 2 // 3, 4), shape * 4 // 3 + 1, 3)
    spacing = np.exp(random.uniform(-1, 1, 3) * np.log(MOST_UNEQUAL))
    spacing /= spacing.prod() ** (1 / 3)
    seed = int(random.integers(2**31))
    # cells of one, two or three voxels, whose faces the grid holds: what is left is the pixel's
    cell = int(random.integers(1, 4))
    counts = np.maximum(counts // cell, 3) * cell
    cells = counts // cell
    grid = VoxelGrid(
        tuple(int(n) for n in counts), tuple(spacing), tuple(random.uniform(-5, 5, 3))
    )
    field = phantoms.RandomHomogeneous(
        seed, grid.extent, grid.center, tuple(int(n) for n in cells)
    )
    scan = simulate(
        _random_rig(random, grid, views, footprint),
        field,
        grid,
        supersample=5,
        refine=2,
        seed=seed,
    )
    system = LinearSystem.from_rig(scan.rig, grid, midpoints=True)
    measured = system.flatten(list(scan.images.values()))
    return Exercise(system.projector, measured, system.projector.live.compress(scan.truth))


def _random_rig(
    random: np.random.Generator, grid: VoxelGrid, views: int, footprint: float | None
) -> rigs.Rig:
    """Return cameras on a circle or an arc, each at a pitch and a distance of its own."""
    count = int(random.integers(max(views // 2, 2), views * 3 // 2 + 1))
    reach = float(np.linalg.norm(grid.extent))
    distance = reach * np.exp(random.uniform(np.log(1.5), np.log(60), count))
    if footprint is None:
        footprint = random.uniform(*FOOTPRINTS)
    side = int(np.ceil(1.3 * reach / footprint))
    options = {
        "image_size": (side, side),
        "footprint": footprint,
        "pitch_degrees": random.uniform(-50, 50, count),
        "center": grid.center,
    }
    if random.random() < 0.5:
        return rigs.arc(count, random.uniform(60, 300), distance, **options)
    return rigs.ring(count, None, distance, start_degrees=random.uniform(0, 360), **options)
