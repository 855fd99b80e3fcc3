"""Gas that absorbs: a medium, gas that absorbs its own light, and a field on a coarse grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from rigs.scene.gas import ExtinctionVolume
from tomo.grid import VoxelGrid
from tomo.model.effect import OfOneParameter, Prediction
from tomo.model.observation import Observation

STEP = 0.05
"""Optical depth of the difference that gives a column. Smaller, single precision shows; larger,
the exponential bends."""


@dataclass(frozen=True)
class Absorbing(OfOneParameter):
    """``A(p) x`` through gas of the optical depth ``p``, of prior standard deviation ``sigma``.

    ``own``: the gas absorbs its own light, ``p`` is the depth along the brightest line of sight.
    Else a medium fills the grid, and ``p`` is the depth across it.
    """

    own: bool
    sigma: float = 0.3
    parameters = ("depth",)
    shared = True
    of_gas = True

    @property
    def name(self) -> str:
        """What reports call it."""
        return "self-absorption" if self.own else "medium"

    def columns(self, at: Prediction) -> NDArray[np.float64]:
        """Return the difference of the prediction by a small depth, ``(1, pixels)``."""
        more = self.applied(at.observation, np.full((len(at.observation.rig), 1), STEP))
        active = at.system.projector.active
        means = at.system.projector.voxel_means(
            active.expand(at.unknowns).reshape(active.grid.shape)
        )
        several = {"supersample": at.observation.supersample}
        absorbing = at.system.with_absorption(more.absorption, means, **several)
        return (np.asarray(absorbing.projector @ at.unknowns, np.float64) - at.pixels)[None] / STEP

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation through gas that absorbs as much more."""
        depth = max(float(values.mean()), 0.0)
        gas = observation.absorption
        if self.own:
            more = replace(gas, emission=gas.emission + depth / observation.brightest)
        else:
            length = float(np.mean(observation.grid.extent))
            more = replace(gas, medium=gas.medium + depth / length)
        return replace(observation, absorption=more)


CELLS = 11
"""Cells of the field along the grid's longest edge, some four voxels each. Fewer: dense clouds are
wider than they are; more: clouds before flames that voxels do not resolve are found in part."""

DIRECTIONS, STEPS = 500, 4
"""Lines from the flame outwards along which a field's depth is said, and steps across a cell."""

ONE_SIDED = 0.5
"""Length of the mean direction of the gas from which it is said to be on one side."""


@dataclass(frozen=True)
class Absorber:
    """``A(p) x`` through an extinction ``p``, trilinear between nodes that span a ``grid``'s box.

    Beer and Lambert's law holds along the segments: a voxel has the mean of the field in it. The
    prior is exponential. Most places have no gas, and one whose nodes explain no more than their
    prior costs has exactly none. ``sigma`` is the depth across a cell that is usual for gas that
    is there: steps end at a tenth of it.
    """

    grid: VoxelGrid
    sigma: float = 0.3
    name = "absorber"
    shared = True
    positive = True
    of_cameras = False
    of_gas = True
    field_of = "medium"

    @cached_property
    def shape(self) -> tuple[int, int, int]:
        """Nodes along each axis."""
        extent = np.asarray(self.grid.extent)
        nx, ny, nz = (max(round(one), 1) + 1 for one in CELLS * extent / extent.max())
        return nx, ny, nz

    @property
    def cell(self) -> float:
        """Edge of a cell, its mean over the axes."""
        return float(np.mean(np.asarray(self.grid.extent) / (np.asarray(self.shape) - 1)))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The nodes, in C order."""
        return tuple(f"{i} {j} {k}" for i, j, k in np.ndindex(self.shape))

    @property
    def units(self) -> tuple[str, ...]:
        """That of extinction."""
        return ("1 / length",) * int(np.prod(self.shape))

    def deviation(self, observation: Observation) -> NDArray[np.float64]:
        """Return the extinction of usual gas, ``(views, nodes)``."""
        size = len(observation.rig), int(np.prod(self.shape))
        return np.full(size, self.sigma / self.cell)

    def columns(self, at: Prediction) -> LinearOperator:
        """Return the operator from nodes to the change of the prediction, ``(pixels, nodes)``."""
        observation, system = at.observation, at.system
        projector, grid = system.projector, system.projector.grid
        volume = projector.active.expand(at.unknowns).reshape(grid.shape)
        change = system.dimming(
            observation.absorption,
            at.unknowns,
            projector.voxel_means(volume),
        )
        return change @ aslinearoperator(self.means_in(grid))

    def applied(self, observation: Observation, values: NDArray[np.float64]) -> Observation:
        """Return the observation through the field, in the place of any other extinction."""
        grid = observation.grid
        means = (self.means_in(grid) @ values[0]).reshape(grid.shape)
        volume = ExtinctionVolume(means, grid.lower, grid.spacing)
        return replace(observation, absorption=replace(observation.absorption, extinction=volume))

    def means_in(self, grid: VoxelGrid) -> scipy.sparse.csr_array:
        """Return the matrix from nodes to means in the voxels of a grid, ``(voxels, nodes)``."""
        axes = []
        for low, high, count, start, step, n in zip(
            self.grid.lower, self.grid.upper, self.shape, grid.lower, grid.spacing, grid.shape,
            strict=True,
        ):  # fmt: skip
            cell = (high - low) / (count - 1)
            faces = (start + step * np.arange(n + 1) - low) / cell  # in cells, (n + 1,)
            t = np.clip(faces[:, None] - np.arange(count), -1, 1)
            area = 0.5 + t - np.sign(t) * t**2 / 2  # of a hat up to t
            axes.append(np.diff(area, axis=0) * cell / step)  # (n, count)
        x, y, z = map(scipy.sparse.csr_array, axes)
        return scipy.sparse.csr_array(scipy.sparse.kron(scipy.sparse.kron(x, y), z))

    def seen_from(
        self, values: NDArray[np.float64], light: NDArray[np.floating]
    ) -> tuple[float, str]:
        """Return the largest optical depth before the flame, and where the gas is in words.

        ``light`` (nx, ny, nz) is the emission in a grid of the same box. Depths are along lines
        from its middle outwards; the mean of their directions, weighted by depths, has the length
        1 where the gas is on one side, and 0 where it is all around.
        """
        ways, size = _directions(DIRECTIONS), np.asarray(self.grid.extent)
        middles = np.indices(light.shape).reshape(3, -1) + 0.5
        weight = np.maximum(light, 0).ravel() + np.finfo(np.float32).tiny
        flame = np.average(middles, axis=1, weights=weight) / light.shape * size
        step = self.cell / STEPS
        along = step * (np.arange(int(np.linalg.norm(size) / step)) + 0.5)
        points = flame + along[:, None, None] * ways  # (steps, directions, 3)
        at = np.moveaxis(points / size * (np.asarray(self.shape) - 1), -1, 0)
        field = map_coordinates(values.reshape(self.shape), at, order=1)  # zero outside
        depth = field.sum(axis=0) * step
        side = ways.T @ depth / max(float(depth.sum()), np.finfo(np.float64).tiny)
        if np.linalg.norm(side) < ONE_SIDED:
            return float(depth.max()), "around the flame"
        large = np.abs(side) > np.abs(side).max() / 2
        axes = [f"{'-' if s < 0 else '+'}{name}" for s, name in zip(side, "xyz", strict=True)]
        names = " ".join(name for name, one in zip(axes, large, strict=True) if one)
        return float(depth.max()), f"beside the flame, on its {names} side,"


def _directions(count: int) -> NDArray[np.float64]:
    """Return unit vectors that are spread evenly over all directions, ``(count, 3)``."""
    number = np.arange(count) + 0.5
    height, turn = 1 - 2 * number / count, np.pi * (1 + np.sqrt(5)) * number
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), height, radius * np.sin(turn)], axis=1)
