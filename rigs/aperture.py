"""The finite aperture of a lens: rays from all over its pupil cross in the plane in focus."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from rigs.camera_protocol import CameraLike

NEEDED = ("focal_length", "f_number", "focus_distance")

_LEAST_AHEAD = 1e-3
"""Cosine to the optical axis below which a line of sight meets the plane in focus too far off."""

_GOLDEN = (math.sqrt(5) - 1) / 2


@dataclass(frozen=True)
class Aperture:
    """The entrance pupil of a thin lens, and the plane that it has in focus.

    The pupil is a disc of ``radius`` around the centre of projection, across the optical axis,
    along which ``focus_distance`` leads to that plane; both are positive. All rays of a pixel
    cross where its line of sight meets the plane. At the depth ``z`` they cover a disc of the
    diameter ``2 r |1 - z / focus_distance|``, the circle of confusion.

    Examples
    --------
    >>> Aperture(radius=9.0, focus_distance=300.0).blur(330.0).round(6)
    np.float64(1.8)
    """

    radius: float
    focus_distance: float

    def __post_init__(self) -> None:
        """Check both values."""
        for name in ("radius", "focus_distance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"aperture: {name}: found {value}, expected a positive number")

    @classmethod
    def of(cls, camera: CameraLike, focus_distance: float | None = None) -> Aperture:
        """Return the aperture of `rigs.Optics`, of radius ``focal_length / (2 f_number)``.

        ``focus_distance`` replaces that of the optics; it has to exceed the focal length.
        """
        known: dict[str, Any] = {name: getattr(camera.optics, name, None) for name in NEEDED}
        known["focus_distance"] = focus_distance or known["focus_distance"]
        missing = [name for name, value in known.items() if value is None]
        if missing:
            line = ", ".join(
                f"{name}: {'?' if value is None else f'{value:g}'}"
                for name, value in known.items()
            )
            raise ValueError(
                f"camera {camera.name}: optics: found no {', '.join(missing)}, expected "
                f"all three for rays over the aperture: write optics: {{{line}}} in rig.yaml, in "
                "its length unit"
            )
        focal_length, f_number, focus = known.values()
        if not focal_length < focus:
            raise ValueError(
                f"camera {camera.name}: optics: found focal_length {focal_length:g} with "
                f"focus_distance {focus:g}, expected a lens that focuses beyond its focal length: "
                "check that both are in the rig's length unit"
            )
        return cls(focal_length / (2 * f_number), focus)

    def blur(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Return the diameter of the circle of confusion at depths along the optical axis."""
        return 2 * self.radius * np.abs(1 - np.asarray(depth, np.float64) / self.focus_distance)

    def rays(
        self,
        camera: CameraLike,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        points: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the rays over the aperture of lines of sight, in the medium of the camera.

        ``camera`` looks straight; its `position` and `R` place the pupil. ``origins, directions``
        ``(N, 3)`` are its lines of sight; ``points`` ``(N, M, 2)`` of the unit disc, right and
        down, those of the pupil in units of its radius.

        Returns
        -------
        origins, directions : (N, M, 3) float64
            Starts, as far ahead as the line of sight's own, and unit directions.
        """
        R, position = np.asarray(camera.R), np.asarray(camera.position)
        ahead = directions @ R[2]
        self.check_ahead(camera.name, ahead)
        pupil = self.radius * (points @ R[:2])  # (N, M, 3), from the centre of projection
        started = (origins - position) @ R[2]  # 0 where lines start at the centre of projection
        left = 1 - started / self.focus_distance
        towards = (directions * (self.focus_distance / ahead)[:, None])[:, None] - pupil
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        return origins[:, None] + pupil * left[:, None, None], towards

    @staticmethod
    def check_ahead(name: str, ahead: NDArray[np.floating]) -> None:
        """Refuse lines of sight that run along, or away from, the plane in focus; NaN passes."""
        if (ahead <= _LEAST_AHEAD).any():
            raise ValueError(
                f"aperture: camera {name}: found a pixel that does not look at the plane in "
                "focus, expected all to look ahead"
            )


def check_apertures(cameras: Iterable[CameraLike]) -> None:
    """Refuse cameras whose optics describe no aperture, see `Aperture.of`."""
    for camera in cameras:
        Aperture.of(camera)


def disc_rule(count: int, turn: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ``count`` points of the unit disc ``(M, 2)`` and their weights ``(M,)``, of sum one.

    Rings at the Gauss-Legendre points of the squared radius, in which a disc's area is even. Each
    has nearly the same number of points, evenly spaced in angle and turned by the golden ratio
    from ring to ring, all by the part ``turn`` of their step. With ``n`` rings of ``4 n`` points
    it is exact for polynomials of degree ``4 n - 1`` (Stroud, Approximate Calculation of Multiple
    Integrals, 1971, section 2.4).

    >>> points, weights = disc_rule(16)
    >>> round(float(weights @ points[:, 0] ** 6), 12)  # 5 / 64
    0.078125
    """
    rings = max(round(math.sqrt(count) / 2), 1)
    nodes, shares = np.polynomial.legendre.leggauss(rings)
    ends = np.rint(np.arange(rings + 1) * count / rings).astype(int)
    several = np.diff(ends)
    ring = np.repeat(np.arange(rings), several)
    number = np.arange(count) - ends[ring]
    angle = 2 * math.pi * (number + (ring * _GOLDEN + turn) % 1) / several[ring]
    radius = np.sqrt((nodes[ring] + 1) / 2)
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return points, shares[ring] / (2 * several[ring])
