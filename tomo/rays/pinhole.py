"""Compiled: the rays of a camera without distortion, and the check of rays.

In numpy, as in `rigs.Camera.rays`, both took a third of the time of tracing: many passes over
short arrays.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

if TYPE_CHECKING:
    from rigs.camera_protocol import CameraLike

FINE, NOT_FINITE, NOT_UNIT, BAD_LENGTH = range(4)

_UNIT = 2e-9
"""Tolerance of a direction's squared length: less refuses rounded vectors, more scales lengths."""


def lines_of_sight(
    camera: CameraLike, pixels: NDArray[np.integer], positions: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and directions, ``(P * K², 3)`` each, as `rigs.Camera.rays` does.

    Parameters
    ----------
    camera : Camera
        Without distortion.
    pixels : (P,) int64
        Flat pixel numbers ``row * width + column``.
    positions : (K², 2) float64
        Of a pixel's rays, down and right of its centre.
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
    """Return the fault of the first ray that no tracer can follow, or `FINE`.

    Parameters
    ----------
    origins, directions : (N, 3) float64
    lengths : (N,) float64
    """
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
