"""What known fields are made of; lengths in voxels, points from the grid's middle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.rotation import matrix_of_vector

Values = NDArray[np.float32]
Shape = Callable[[NDArray[np.float32]], Values]  # from points ``(N, 3)`` to emission ``(N,)``
FAR = 6.0  # widths from a Gaussian's middle beyond which it is 1e-8 and not computed


def bell(distance: Values, width: ArrayLike) -> Values:
    """Return the Gaussian ``exp(-distance² / (2 width²))``."""
    return np.exp(np.float32(-0.5) * np.square(distance / np.float32(width)))


def smooth_step(x: Values) -> Values:
    """Return 0 below 0, 1 above 1, and the cubic ``x² (3 - 2 x)`` between them."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def fade(points: NDArray[np.float32], half: NDArray, axes: str = "xyz", over: float = 3) -> Values:
    """Return a window ``(N,)``: 1 inside, falling to 0 over the last voxels before the faces."""
    window = np.ones(len(points), np.float32)
    for axis in ("xyz".index(name) for name in axes):
        inside = np.float32(half[axis]) - np.abs(points[:, axis])
        window *= smooth_step(inside / np.float32(over))
    return window


def blobs(centres: NDArray, widths: NDArray, amplitudes: NDArray) -> Shape:
    """Return a sum of isotropic Gaussians: ``(B, 3)``, ``(B,)``, ``(B,)``."""

    def emission(points: NDArray[np.float32]) -> Values:
        found = np.zeros(len(points), np.float32)
        height = np.ascontiguousarray(points[:, 1])
        for centre, width, amplitude in zip(centres, widths, amplitudes, strict=True):
            near = np.flatnonzero(np.abs(height - np.float32(centre[1])) < FAR * width)
            away = points[near] - centre.astype(np.float32)
            square = np.einsum("ij,ij->i", away, away)
            found[near] += np.float32(amplitude) * np.exp(square * np.float32(-0.5 / width**2))
        return found

    return emission


def rods(starts: NDArray, ends: NDArray, widths: NDArray, amplitudes: NDArray) -> Shape:
    """Return the brightest of straight rods, not their sum: those that meet do not make a knot."""

    def emission(points: NDArray[np.float32]) -> Values:
        found = np.zeros(len(points), np.float32)
        height = np.ascontiguousarray(points[:, 1])
        for start, end, width, amplitude in zip(starts, ends, widths, amplitudes, strict=True):
            along, middle = (end - start).astype(np.float32), (start[1] + end[1]) / 2
            reach = abs(end[1] - start[1]) / 2 + FAR * width
            near = np.flatnonzero(np.abs(height - np.float32(middle)) < reach)
            away = points[near] - start.astype(np.float32)
            part = np.clip(away @ along / (along @ along), 0, 1)
            away -= part[:, None] * along
            square = np.einsum("ij,ij->i", away, away)
            rod = np.float32(amplitude) * np.exp(square * np.float32(-0.5 / width**2))
            found[near] = np.maximum(found[near], rod)
        return found

    return emission


def waves(
    random: np.random.Generator, count: int, shortest: float, longest: float
) -> Callable[[NDArray[np.float32]], Values]:
    """Return a smooth random function of mean 0 and variance 1: plane waves in all directions.

    Wavelengths are spread geometrically; amplitudes grow with their cube root, as in turbulence.
    """
    lengths = np.geomspace(shortest, longest, count)
    directions = random.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    vectors = (2 * np.pi * directions / lengths[:, None]).astype(np.float32)
    phases = random.uniform(0, 2 * np.pi, count).astype(np.float32)
    sizes = np.cbrt(lengths)
    sizes = (sizes * np.sqrt(2 / np.square(sizes).sum())).astype(np.float32)
    return lambda points: np.cos(points @ vectors.T + phases) @ sizes


def turned(
    random: np.random.Generator, least: float, most: float
) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
    """Return a tilt of points about a random level axis, by ``least`` to ``most`` degrees."""
    angle, around = np.deg2rad(random.uniform(least, most)), random.uniform(0, 2 * np.pi)
    R = matrix_of_vector(angle * np.array([np.cos(around), 0, np.sin(around)])).astype(np.float32)
    return lambda points: points @ R
