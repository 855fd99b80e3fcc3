"""Grids and rays that no user will ask more of, and what a ray in a box has to measure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.rays import Rays

EPS = float(np.finfo(np.float64).eps)

SHAPE = (20, 14, 17)

TILTED = "hardly tilted"
"""In the name of cases whose rays change sides where rounding makes them."""

STEEPEST = 0.05  # least share of a ray's direction along any axis where voxels are compared


@dataclass(frozen=True)
class Case:
    """A grid with rays.

    Attributes
    ----------
    name : str
    grid : VoxelGrid
    rays : Rays
    """

    name: str
    grid: VoxelGrid
    rays: Rays

    @property
    def rounding(self) -> float:
        """How coarse world coordinates are, in voxels: of the farthest origin or corner.

        A float64 coordinate is good to half its last bit; the grid's own size in voxels is what
        is left once everything is measured from the grid.
        """
        reach = np.maximum(np.abs(self.rays.origins).max(axis=0), np.abs(self.grid.center))
        from_grid = np.abs(self.rays.origins - self.grid.center).max(axis=0) + self.grid.extent
        return EPS * float((np.maximum(reach, from_grid) / self.grid.spacing).max())


def oblique(n: int, random: np.random.Generator) -> NDArray[np.float64]:
    """Return unit vectors (n, 3) that are nowhere near parallel to a face."""
    found = random.uniform(STEEPEST, 1, (n, 3)) * random.choice([-1.0, 1.0], (n, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def through(grid: VoxelGrid, n: int, random: np.random.Generator, distance: float) -> Rays:
    """Return rays to points in the grid from ``distance`` voxels away, oblique in voxels."""
    target = random.uniform(0.02, 0.98, (n, 3)) * grid.extent + grid.lower
    away = oblique(n, random) * grid.spacing
    return Rays.from_lines(target - distance * away, away)


def distances(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Cameras from inside the grid to 1e8 voxels away."""
    grid = VoxelGrid(SHAPE, 0.5, (1, 2, 3))
    for distance in (0, 1, 1e2, 1e4, 1e6, 1e8):
        yield Case(f"{distance:g} voxels away", grid, through(grid, n, random, distance))


def voxel_sizes(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Voxels of 1e-9 to 1e9 units, seen from 50 voxels away."""
    for size in (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9):
        grid = VoxelGrid(SHAPE, size, (3 * size, -2 * size, size))
        yield Case(f"voxels of {size:g}", grid, through(grid, n, random, 50))


def far_grids(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Grids up to 1e7 voxels off the origin."""
    for off in (1e3, 1e5, 1e7):
        for toward in ((1, 0, 0), (-0.6, 0.3, 1)):
            grid = VoxelGrid(SHAPE, 0.1, tuple(off * 0.1 * np.array(toward)))
            yield Case(f"{off:g} voxels off", grid, through(grid, n, random, 50))


def flat_voxels(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Voxels a thousand times longer along some axes than along others."""
    for pattern in range(1, 7):
        spacing = tuple(1e3 if pattern >> axis & 1 else 1.0 for axis in range(3))
        grid = VoxelGrid(SHAPE, spacing, (5, 5, 5))
        yield Case(f"voxels of {spacing}", grid, through(grid, n, random, 50))


def thin_grids(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Grids of one voxel along one, two or all axes."""
    for pattern in range(7):
        shape = tuple(side if pattern >> axis & 1 else 1 for axis, side in enumerate(SHAPE))
        grid = VoxelGrid(shape, (0.3, 0.5, 0.7), (1, -1, 2))
        yield Case(f"grid of {shape}", grid, through(grid, n, random, 30))


def special_rays(n: int, random: np.random.Generator) -> Iterator[Case]:
    """Rays along faces, edges and axes, through corners, and with subnormal direction parts."""
    grids = (
        VoxelGrid((8, 6, 10), 0.5, (1, 2, 3)),  # exact in binary
        VoxelGrid((7, 9, 5), 0.1, (333.3, -77.7, 5.5)),
        VoxelGrid((1, 9, 8), (0.3, 0.7, 1e-3)),
    )
    for grid in grids:
        number = np.stack([random.integers(0, m + 1, n) for m in grid.shape], axis=1)
        corner = np.where(number == grid.shape, grid.upper, grid.lower + number * grid.spacing)
        inside = random.uniform(grid.lower, grid.upper, (n, 3))
        axis = np.eye(3)[random.integers(0, 3, n)] * random.choice([-1.0, 1.0], (n, 1))
        in_plane = random.standard_normal((n, 3)) * (random.random((n, 3)) > 0.4)
        in_plane[~in_plane.any(axis=1)] = (0, 0, -1)
        corner_to_corner = random.integers(-1, 2, (n, 3)) * np.array(grid.spacing)
        corner_to_corner[~corner_to_corner.any(axis=1)] = (1, 0, 0)
        subnormal = axis + random.choice([5e-324, 1e-310, -5e-324, 1e-300, -1e-200, 0], (n, 3))
        tilted = axis + random.choice([-1, 1], (n, 3)) * 10.0 ** random.uniform(-18, -6, (n, 3))
        for name, points, directions in (
            ("axis-parallel", inside, axis),
            ("along edges", corner, axis),
            ("in faces", corner, in_plane),
            ("from corner to corner", corner, corner_to_corner),
            ("with subnormal parts", inside, subnormal),
            ("along edges with subnormal parts", corner, subnormal),
            (f"{TILTED} from edges", corner, tilted),
        ):
            unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
            back = random.choice([0.0, 16.0, 2.0**20], (n, 1))
            yield Case(f"{name}, {grid.shape}", grid, Rays.from_lines(points - back * unit, unit))


def chord(case: Case, outward: float = 0.0) -> NDArray[np.float64]:
    """Return the length of each ray in the box whose faces move ``outward`` voxels: (rays,).

    By the slab method in world coordinates and extended precision, which no tracer uses.
    """
    rays, grid = case.rays, case.grid
    origin, direction = rays.origins.astype(np.longdouble), rays.directions.astype(np.longdouble)
    margin = np.longdouble(outward) * np.longdouble(grid.spacing)
    half = np.longdouble(grid.shape) * np.longdouble(grid.spacing) / 2
    low, high = grid.center - half - margin - origin, grid.center + half + margin - origin
    still = np.abs(direction) < 1e-300  # what does not move it within any box that there is
    divisor = np.where(still, 1, direction)
    between = (low <= 0) & (high >= 0)
    ends = np.stack([low / divisor, high / divisor])
    near = np.where(still, np.where(between, -np.inf, np.inf), ends.min(axis=0))
    far = np.where(still, np.where(between, np.inf, -np.inf), ends.max(axis=0))
    start = np.maximum(near.max(axis=1), 0)
    return np.maximum(np.minimum(far.min(axis=1), rays.lengths) - start, 0).astype(np.float64)


def roundings_apart(case: Case, total: NDArray[np.float64]) -> float:
    """Return how many roundings of coordinates explain where sums of chords (rays,) are.

    A ray that grazes the box is as long as rounding its coordinates makes it: the sums have to
    lie between what boxes smaller and larger by so many roundings measure.
    """
    slack = 8 * EPS * max(float(chord(case).max(initial=0.0)), 1e-300)  # of adding them up

    def explained(roundings: float) -> bool:
        outward = roundings * case.rounding
        most, least = chord(case, outward), chord(case, -outward)
        return bool(((total <= most + slack) & (total >= least - slack)).all())

    low, high = 0.0, 64.0
    if not explained(high):
        return np.inf
    if explained(low):
        return low
    for _ in range(8):
        middle = (low + high) / 2
        low, high = (low, middle) if explained(middle) else (middle, high)
    return high
