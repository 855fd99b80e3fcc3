"""A turbulent premixed flame: a thin front wrinkled by a spectrum of scales."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phantoms.field import REFERENCE_EXTENT, FlameField, bump, smoothstep
from phantoms.modes import Modes

_WRINKLES = 40  # Fourier modes that displace the front
_WAVELENGTHS = (2.8, 18.0)  # mm, finest and coarsest wrinkle
_PATCHES = 12  # Fourier modes that modulate its brightness
_PATCH_WAVELENGTHS = (5.0, 24.0)  # mm
_HALF_WIDTH = 1.75  # mm, where the front's profile ends; full width at half maximum 1.4 mm
_WALL = 5.0  # mm from the axis, beyond which the level set grows and keeps the front inside
_WALL_SLOPE = 2.0  # of that growth
_WALL_ROUNDING = 0.5  # mm, over which it sets in
_AXIS_ROUNDING = 0.6  # mm, over which the radius is smoothed across the axis
_LEAST_SLOPE = 0.5  # lower bound of |∇G|, which vanishes where fronts merge
_MOTION = 1  # a stream of its own: the flame at time 0 is the still one


@dataclass(frozen=True)
class TurbulentFlame(FlameField):
    """A jet flame's front wrinkled by turbulence: asymmetric, folded, with islands of gas.

    The front is the zero of a level set (the G equation of premixed flames) ::

        G(x) = r - R(y) + wall(r) + A(y) Σ aₘ cos(kₘ·x + φₘ)

    with directions and phases of the modes from the seed and wavenumbers in geometric steps. In
    Kolmogorov's inertial range the spectrum falls as k^(-5/3), so a geometric step holds a
    variance proportional to k^(-2/3), and ``aₘ ∝ kₘ^(-1/3)``. The amplitude ``A`` grows along the
    flame, from a smooth base to a brush with detached pockets. Emission is
    ``bump((s / 1.75 mm)²)`` across the front, where ``s = G / √(|∇G|² + 0.5²)`` (``∇G`` is
    analytic) is the distance from it to first order, kept finite where fronts merge: 1.4 to
    1.6 mm wide at half maximum, about three voxels of 0.5 mm. It is dimmed where strain, modelled
    by ``|∇G|``, is high, and by random patches.

    The flame moves (`phantoms.modes.Modes.after`): wrinkles and patches travel up with the gas at
    4 m/s, 0.4 mm in a frame of 10 000 a second, and change as they go, within about ten such
    frames; the base stays where it is.

    The emission ranges from 0 to about 1 and is exactly zero off the front. Its second derivatives
    are bounded, and continuous except at one height, where the wrinkling is fully grown.

    Parameters
    ----------
    seed, extent, center, time
        As in :class:`phantoms.FlameField`.
    """

    _wrinkles: Modes = field(init=False, repr=False, compare=False)
    _patches: Modes = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw the modes."""
        super().__post_init__()
        random = np.random.default_rng(self.seed)
        motion = np.random.default_rng((self.seed, _MOTION))
        for name, count, lengths in (
            ("_wrinkles", _WRINKLES, _WAVELENGTHS),
            ("_patches", _PATCHES, _PATCH_WAVELENGTHS),
        ):
            modes = Modes.draw(random, count, lengths).after(self.time, motion)
            object.__setattr__(self, name, modes)

    def _emission(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        distance, slope = self._front(points)
        emission = np.zeros(len(points))
        near = np.abs(distance) < _HALF_WIDTH
        brightness = self._patches.values(points[near])
        brightness = 0.35 + 0.65 / (1 + np.exp(-2.0 * brightness))
        strain = 1 / (1 + 0.25 * slope[near] ** 2)
        emission[near] = bump((distance[near] / _HALF_WIDTH) ** 2) * brightness * 1.25 * strain
        return emission

    def _front(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the distance ``(N,)`` to the front, negative inside it, and ``|∇G|`` ``(N,)``."""
        height = points[:, 1] / REFERENCE_EXTENT[1] + 0.5  # (N,), 0 to 1
        rounded = np.sqrt(points[:, 0] ** 2 + points[:, 2] ** 2 + _AXIS_ROUNDING**2)
        mean, mean_slope = _mean_radius(height)
        gain, gain_slope = _wrinkling(height)
        wrinkle, wrinkle_gradient = self._wrinkles.values_and_gradients(points)

        # Linear far out: a steeper wall would reduce G / |∇G| there and emit.
        push, push_slope = _wall(rounded)
        level = rounded - _AXIS_ROUNDING - mean + push + gain * wrinkle
        gradient = gain[:, None] * wrinkle_gradient  # (N, 3)
        radial = (1 + push_slope) / rounded
        gradient[:, 0] += radial * points[:, 0]
        gradient[:, 2] += radial * points[:, 2]
        gradient[:, 1] += (gain_slope * wrinkle - mean_slope) / REFERENCE_EXTENT[1]
        slope = np.sqrt((gradient**2).sum(axis=1) + _LEAST_SLOPE**2)
        return level / slope, slope


def _mean_radius(height: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean front's radius in mm and its derivative; below zero beyond the tip."""
    return 2.0 + 4.2 * height - 7.5 * height**4, 4.2 - 30.0 * height**3


def _wrinkling(height: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the RMS displacement of the front in mm and its derivative."""
    x = np.clip(height / 0.6, 0, 1)
    return 0.25 + 1.25 * smoothstep(x), 1.25 / 0.6 * 30 * (x * (1 - x)) ** 2


def _wall(radius: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a level in mm that grows beyond the wall's radius, and its derivative."""
    x = (radius - _WALL) / _WALL_ROUNDING
    return _WALL_SLOPE * _WALL_ROUNDING * np.logaddexp(0, x), _WALL_SLOPE / (1 + np.exp(-x))
