"""The rays of a pixel: through its area and the lens' aperture; compiled without distortion."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.aperture import disc_rule
from tomo._compute.jit import compiled

if TYPE_CHECKING:
    from rigs.camera_protocol import CameraLike

FEWEST_POINTS = 2
"""Points of the aperture for each position in a pixel: one alone looks from beside the lens'
middle, and shifts the position's share of the image."""


def positions_in_pixel(supersample: int) -> NDArray[np.float64]:
    """Return the positions of a pixel's rays, down and right of its centre, ``(K², 2)``."""
    steps = steps_in_pixel(supersample)
    return np.stack([np.repeat(steps, supersample), np.tile(steps, supersample)], axis=1)


def steps_in_pixel(supersample: int) -> NDArray[np.float64]:
    """Return the positions of a pixel's rays along one side, from its centre, ``(K,)``."""
    return (np.arange(supersample) + 0.5) / supersample - 0.5


def points_of_aperture(
    supersample: int, aperture_rays: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of the pupil that each position in a pixel looks from, and their weights.

    ``(K², M, 2)`` in the unit disc, right and down, and ``(M,)`` of sum one. Each position has the
    rule of `rigs.aperture.disc_rule`, turned: together they are a finer one.
    """
    several = supersample**2
    if aperture_rays == 1:
        return np.zeros((several, 1, 2)), np.ones(1)
    count = rays_of_pixel(supersample, aperture_rays) // several
    rules = [disc_rule(count, number / several) for number in range(several)]
    return np.stack([points for points, _ in rules]), rules[0][1]


def rays_of_pixel(supersample: int, aperture_rays: int = 1) -> int:
    """Return how many rays a pixel has; both numbers have to be whole ones from one on."""
    for name, value in (("supersample", supersample), ("aperture_rays", aperture_rays)):
        if not (value >= 1 and value % 1 == 0):
            raise ValueError(f"{name}: found {value}, expected a whole number >= 1")
    several = int(supersample) ** 2
    if aperture_rays == 1:
        return several
    return several * max(-(-int(aperture_rays) // several), FEWEST_POINTS)


FINE, NOT_FINITE, NOT_UNIT, BAD_LENGTH = range(4)

_UNIT = 2e-9
"""Tolerance of a direction's squared length: less refuses rounded vectors, more scales lengths."""


def lines_of_sight(
    camera: CameraLike, pixels: NDArray[np.integer], positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and directions, ``(P * K², 3)`` each, as `rigs.Camera.rays` does.

    ``camera`` is without distortion, ``pixels`` ``(P,)`` are flat numbers, ``positions``
    ``(K², 2)`` those of a pixel's rays, down and right of its centre.
    """
    (fx, skew, cx), (_, fy, cy) = camera.camera_matrix[:2]
    shape = (len(pixels) * len(positions), 3)
    origins, directions = np.zeros(shape), np.zeros(shape)
    lens = float(fx), float(skew), float(cx), float(fy), float(cy)
    _look(
        pixels, camera.image_size[0], positions, lens, np.ascontiguousarray(camera.R),
        camera.position, origins, directions,
    )  # fmt: skip
    return origins, directions


@compiled()
def _look(pixels, width, positions, lens, rotation, position, origins, directions) -> None:
    """Write the rays of all positions of a pixel, pixel after pixel."""
    fx, skew, cx, fy, cy = lens
    at = 0
    for pixel in pixels:
        row = pixel // width
        column = pixel - row * width
        for ray in range(len(positions)):
            y = (row + positions[ray, 0] - cy) / fy
            x = (column + positions[ray, 1] - cx - skew * y) / fx
            far = math.sqrt(x * x + y * y + 1)
            for axis in range(3):
                ahead = x * rotation[0, axis] + y * rotation[1, axis] + rotation[2, axis]
                directions[at, axis] = ahead / far
                origins[at, axis] = position[axis]
            at += 1


@compiled()
def first_fault(
    origins: NDArray[np.float64], directions: NDArray[np.float64], lengths: NDArray[np.float64]
) -> int:
    """Return the fault of the first ray that no tracer can follow, or `FINE`."""
    for n in range(len(lengths)):
        total = square = 0.0
        for axis in range(3):
            total += 0.0 * origins[n, axis]
            square += directions[n, axis] ** 2
        if total != 0:  # NaN as well
            return NOT_FINITE
        if not abs(square - 1) < _UNIT:
            return NOT_UNIT
        if not lengths[n] >= 0:
            return BAD_LENGTH
    return FINE
