"""Images of a flame by dense sampling along the straight pieces that closed-form optics give.

The midpoint rule, as in `studies.scenes.forward`, compiled: an open aperture takes hundreds of
rays a pixel.

The flame is linear between nodes, four to a voxel. This interpolant, not what was sampled, is the
truth: its line integrals and its voxel means are then those of one field.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import convolve1d, map_coordinates, maximum_filter

import phantoms
from rigs.compiled import compiled
from studies.optics.sights import Sight
from studies.scenes.forward import crossing
from tomo import VoxelGrid

PER_VOXEL = 4  # nodes along a voxel's edge; a front of three voxels is then twelve nodes wide


@dataclass(frozen=True)
class Flame:
    """A turbulent flame that fills a grid of cubic voxels."""

    seed: int  # see `phantoms.TurbulentFlame`
    grid: VoxelGrid

    @cached_property
    def nodes(self) -> NDArray[np.float32]:
        """Emission at the nodes, ``(4 nx + 1, 4 ny + 1, 4 nz + 1)``, to the faces."""
        flame = phantoms.TurbulentFlame(self.seed, self.grid.extent, self.grid.center)
        x, y, z = (
            np.linspace(low, high, PER_VOXEL * n + 1)
            for low, high, n in zip(self.grid.lower, self.grid.upper, self.grid.shape, strict=True)
        )
        values = np.zeros((len(x), len(y), len(z)), np.float32)
        for number, place in enumerate(x):
            points = np.stack(np.meshgrid([place], y, z, indexing="ij"), axis=-1)
            values[number] = flame(points)[0]
        return values

    @property
    def spacing(self) -> float:
        """Length between two nodes."""
        return self.grid.spacing[0] / PER_VOXEL

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The box outside of which there is no light."""
        return self.grid.lower, self.grid.upper

    @cached_property
    def lit(self) -> NDArray[np.uint8]:
        """Whether a voxel holds light, ``(nx, ny, nz)``."""
        widest = maximum_filter(self.nodes, PER_VOXEL + 1)
        half = PER_VOXEL // 2
        return (widest[half::PER_VOXEL, half::PER_VOXEL, half::PER_VOXEL] > 0).astype(np.uint8)

    @cached_property
    def means(self) -> NDArray[np.float32]:
        """The means over the voxels, ``(nx, ny, nz)``: exact for a field linear between nodes."""
        weights = np.full(PER_VOXEL + 1, 1 / PER_VOXEL)
        weights[[0, -1]] /= 2
        values = self.nodes.astype(np.float64)
        for axis in range(3):
            values = convolve1d(values, weights, axis=axis)
        half = PER_VOXEL // 2
        return values[half::PER_VOXEL, half::PER_VOXEL, half::PER_VOXEL].astype(np.float32)

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)`` at ``points`` ``(..., 3)``, zero outside the grid."""
        places = (np.asarray(points, np.float64) - self.grid.lower) / self.spacing
        return map_coordinates(self.nodes, np.moveaxis(places, -1, 0), order=1, cval=0.0)


STEP = 2.0
"""Nodes between two samples of a ray: its light is then added to 1e-4 of the brightest (RMS)."""


def image(sight: Sight, flame: Flame, extinction: float = 0.0) -> NDArray[np.float64]:
    """Return the image ``(height, width)``: the mean over a pixel's rays of line integrals.

    Light is dimmed by ``exp(-a L)``, with the extinction ``a`` and the length ``L`` in the grid.
    """
    width, height = sight.camera.image_size
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    total = np.zeros(len(pixels))
    for offset, lens in sight.quadrature():
        for piece in sight.pieces(pixels + offset, lens):
            total += line_integrals(flame, *piece, extinction)
    return (total / len(sight.quadrature())).reshape(height, width)


def line_integrals(
    flame: Flame,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    lengths: NDArray[np.float64],
    extinction: float = 0.0,
) -> NDArray[np.float64]:
    """Return what arrives at the origins of pieces ``(N, 3)`` so long ``(N,)``."""
    lit = np.argwhere(flame.lit)
    edge = flame.grid.spacing[0]
    lower = flame.grid.lower + edge * lit.min(axis=0)
    upper = flame.grid.lower + edge * (lit.max(axis=0) + 1)
    first, last = crossing(origins, directions, lower, upper)
    enters = crossing(origins, directions, *flame.reach)[0] if extinction else first
    return _integrals(
        flame.nodes,
        flame.lit,
        (origins - flame.grid.lower) / flame.spacing,
        directions / flame.spacing,
        first,
        np.minimum(last, lengths),
        enters,
        STEP * flame.spacing,
        extinction,
    )


@compiled
def _integrals(nodes, lit, origins, directions, first, last, enters, step, extinction):
    """Return the integrals ``(N,)``; origins and directions in nodes, distances in lengths."""
    found = np.zeros(len(origins))
    most = (nodes.shape[0] - 2, nodes.shape[1] - 2, nodes.shape[2] - 2)
    for ray in range(len(origins)):
        reach = last[ray] - first[ray]
        if not reach > 0:
            continue
        count = int(np.ceil(reach / step))
        length, total = reach / count, 0.0
        for sample in range(count):
            along = first[ray] + (sample + 0.5) * length
            x = origins[ray, 0] + along * directions[ray, 0]
            y = origins[ray, 1] + along * directions[ray, 1]
            z = origins[ray, 2] + along * directions[ray, 2]
            i = min(max(int(x), 0), most[0])
            j = min(max(int(y), 0), most[1])
            k = min(max(int(z), 0), most[2])
            if lit[i // PER_VOXEL, j // PER_VOXEL, k // PER_VOXEL] == 0:
                continue
            x, y, z = x - i, y - j, z - k
            near = (1 - y) * ((1 - z) * nodes[i, j, k] + z * nodes[i, j, k + 1]) + y * (
                (1 - z) * nodes[i, j + 1, k] + z * nodes[i, j + 1, k + 1]
            )
            i += 1
            far = (1 - y) * ((1 - z) * nodes[i, j, k] + z * nodes[i, j, k + 1]) + y * (
                (1 - z) * nodes[i, j + 1, k] + z * nodes[i, j + 1, k + 1]
            )
            emission = (1 - x) * near + x * far
            if extinction > 0:
                emission *= np.exp(-extinction * (along - enters[ray]))
            total += emission
        found[ray] = total * length
    return found
