"""Where pixels look, in closed form: through a plate, past a rod, by a mirror, through a lens.

Each gives the straight pieces of pixels' lines of sight that can lie in the flame. Nothing here is
of `rigs.scene`, which is judged by these images.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigs import Camera

Lines = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Origins and directions ``(N, 3)``, lengths ``(N,)``, infinite for pieces that nothing ends."""

Vector = tuple[float, float, float]

SUPERSAMPLE = 3  # rays along a pixel's side, where the aperture is a point
LENS_RAYS = 256
"""Rays a pixel through an open aperture, each through another point of lens and pixel."""

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
PLASTIC = 1.3247179572447460
"""The number whose powers spread points evenly over a square: Roberts' sequence R2."""


@dataclass(frozen=True)
class Sight:
    """What a pinhole camera sees with nothing in its way."""

    camera: Camera  # where it really stands

    def quadrature(self) -> list[tuple[NDArray, NDArray]]:
        """Return a pixel's rays, of equal weight: positions on the pixel and on the unit disc."""
        steps = (np.arange(SUPERSAMPLE) + 0.5) / SUPERSAMPLE - 0.5
        return [(np.array([right, down]), np.zeros(2)) for right in steps for down in steps]

    def pieces(self, uv: NDArray[np.float64], lens: NDArray[np.float64]) -> list[Lines]:
        """Return the pieces of the pixels ``uv`` ``(N, 2)`` through one point of the lens."""
        del lens
        origins, directions = self.camera.rays(uv)
        return [(np.array(origins), np.array(directions), np.full(len(uv), np.inf))]


@dataclass(frozen=True)
class ThroughPlate(Sight):
    """Through a plane-parallel plate in air, which shifts rays and leaves their directions.

    The part ``d_t`` of a direction along the faces is ``d_t / n`` in the plate, so a ray that
    crosses the thickness ``t`` is shifted by ``t d_t (1 / (n cos b) - 1 / cos a)``.
    """

    normal: Vector
    thickness: float
    index: float

    def pieces(self, uv: NDArray[np.float64], lens: NDArray[np.float64]) -> list[Lines]:
        """Return the pieces behind the plate."""
        ((origins, directions, lengths),) = super().pieces(uv, lens)
        cosine = directions @ np.asarray(self.normal)
        along = directions - cosine[:, None] * self.normal
        cosine = np.abs(cosine)
        inside = np.sqrt(self.index**2 - 1 + cosine**2)
        shift = self.thickness * along * (1 / inside - 1 / cosine)[:, None]
        return [(origins + shift, directions, lengths)]


@dataclass(frozen=True)
class PastRod(Sight):
    """Past an opaque cylinder without ends: light from behind it does not arrive.

    A ray at the distance ``w`` from the axis, ``w = o + s d`` across it, meets the radius ``r``
    where ``|w|² = r²``: the smaller root ends the piece.
    """

    point: Vector
    axis: Vector
    radius: float

    def pieces(self, uv: NDArray[np.float64], lens: NDArray[np.float64]) -> list[Lines]:
        """Return the pieces in front of the rod."""
        ((origins, directions, lengths),) = super().pieces(uv, lens)
        axis = np.asarray(self.axis)
        away = origins - self.point
        away = away - (away @ axis)[:, None] * axis
        across = directions - (directions @ axis)[:, None] * axis
        square = np.square(across).sum(axis=1)
        half = (away * across).sum(axis=1)
        inside = half**2 - square * (np.square(away).sum(axis=1) - self.radius**2)
        met = (inside > 0) & (half < 0)
        reach = (-half - np.sqrt(np.where(met, inside, 0))) / square
        return [(origins, directions, np.where(met, reach, lengths))]


@dataclass(frozen=True)
class ByMirror(Sight):
    """By a plane mirror, a rectangle whose back is opaque; pixels that miss it look straight on.

    The direction ``d`` goes on as ``d - 2 (d · n) n``.
    """

    point: Vector
    normal: Vector
    up: Vector
    size: tuple[float, float]

    def pieces(self, uv: NDArray[np.float64], lens: NDArray[np.float64]) -> list[Lines]:
        """Return the pieces up to the mirror, and those behind it."""
        ((origins, directions, lengths),) = super().pieces(uv, lens)
        normal, up = np.asarray(self.normal), np.asarray(self.up)
        slope = directions @ normal
        reach = ((self.point - origins) @ normal) / slope
        hit = origins + reach[:, None] * directions
        width, height = self.size
        met = (reach > 0) & (np.abs((hit - self.point) @ np.cross(up, normal)) <= width / 2)
        met &= np.abs((hit - self.point) @ up) <= height / 2
        turned = directions - 2 * slope[:, None] * normal
        return [
            (origins, directions, np.where(met, reach, lengths)),
            (hit, turned, np.where(met & (slope < 0), np.inf, 0.0)),
        ]


@dataclass(frozen=True)
class ThroughLens(Sight):
    """Through a thin lens with an open aperture, by the camera's focal length, f-number and focus.

    A pixel sees all lines from the aperture, of the diameter ``f / N`` around the camera's
    position, through the point in focus, where the pixel's middle ray meets the plane at the
    focus distance. Points of the aperture lie on a sunflower: each stands for the same area.
    """

    rays: int = LENS_RAYS

    def quadrature(self) -> list[tuple[NDArray, NDArray]]:
        """Return a pixel's rays: each through another point of the pixel and of the aperture."""
        return _sunflower(self.rays)

    def pieces(self, uv: NDArray[np.float64], lens: NDArray[np.float64]) -> list[Lines]:
        """Return the pieces through one point of the lens."""
        ((origins, directions, lengths),) = super().pieces(uv, lens)
        optics, R = self.camera.optics, self.camera.R
        radius = optics.focal_length / optics.f_number / 2
        reach = optics.focus_distance / (directions @ R[2])
        start = origins + radius * (lens @ R[:2])
        directions = origins + reach[:, None] * directions - start
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return [(start, directions, lengths)]


@lru_cache(maxsize=4)
def _sunflower(count: int) -> list[tuple[NDArray, NDArray]]:
    number = np.arange(count)
    angle, radius = GOLDEN_ANGLE * number, np.sqrt((number + 0.5) / count)
    lens = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    steps = np.array([1 / PLASTIC, 1 / PLASTIC**2])
    offsets = (0.5 + number[:, None] * steps) % 1 - 0.5
    return list(zip(offsets, lens, strict=True))
