"""Lines of sight of a camera without distortion, and what rays have to hold to, compiled.

As numpy has them, in `rigs.Camera.rays` and in words in `tomo.rays.Rays`, they took a third of
the time of tracing them: many passes over arrays that are just too short for a processor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled

if TYPE_CHECKING:
    from rigs import Camera

FINE, NOT_FINITE, NOT_UNIT, NOT_LONG = range(4)

_UNIT = 2e-9  # how far the square of a direction's length may be from one


def lines_of_sight(
    camera: Camera, pixels: NDArray[np.int64], places: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and directions, ``(P * K², 3)`` each, as `rigs.Camera.rays` does.

    Parameters
    ----------
    camera : Camera
        Without distortion.
    pixels : (P,) int64
        Flat pixel numbers ``row * width + column``.
    places : (K², 2) float64
        Where the rays of a pixel are, down and right of its centre.
    """
    (fx, skew, cx), (_, fy, cy) = camera.camera_matrix[:2]
    shape = (len(pixels) * len(places), 3)
    origins, directions = np.zeros(shape), np.zeros(shape)
    lens = float(fx), float(skew), float(cx), float(fy), float(cy)
    _look(
        pixels, camera.image_size[0], places, lens, np.ascontiguousarray(camera.R),
        camera.position, origins, directions,
    )  # fmt: skip
    return origins, directions


@compiled()
def _look(pixels, width, places, lens, turned, position, origins, directions) -> None:
    """Write the lines of sight of all places of a pixel, pixel after pixel."""
    fx, skew, cx, fy, cy = lens
    at = 0
    for pixel in pixels:
        row = pixel // width
        column = pixel - row * width
        for place in range(len(places)):
            y = (row + places[place, 0] - cy) / fy
            x = (column + places[place, 1] - cx - skew * y) / fx
            far = math.sqrt(x * x + y * y + 1)
            for axis in range(3):
                ahead = x * turned[0, axis] + y * turned[1, axis] + turned[2, axis]
                directions[at, axis] = ahead / far
                origins[at, axis] = position[axis]
            at += 1


@compiled()
def what_is_wrong(
    origins: NDArray[np.float64], directions: NDArray[np.float64], lengths: NDArray[np.float64]
) -> int:
    """Return what the first bad ones of rays have that no tracer can follow, or `FINE`.

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
            return NOT_LONG
    return FINE
