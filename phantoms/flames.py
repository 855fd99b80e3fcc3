"""Flames: a laminar jet, a plume of lit gas, a turbulent premixed flame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phantoms.field import REFERENCE_EXTENT, FlameField, bump, smoothstep
from phantoms.modes import SPEED, Modes

_NOZZLE_RADIUS = 1.7  # mm
_SPREAD = 4.0  # mm of growth of the sheet's radius over the box's height, without the tip
_TIP = 0.68  # of the height
_CLOSING = 0.25  # mm, rounding of the sheet where it closes at the tip
_PUFFS = 6  # undulations of the sheet's radius over the box's height
_PULSE = 250.0  # Hz, of the flow: 40 frames at 10 000 a second
_PULSE_DEPTH = 0.3  # of the emission


@dataclass(frozen=True)
class JetFlame(FlameField):
    """A laminar jet flame: hollow above the nozzle, closed at a tip, with a widening plume.

    At height ``h`` (0 to 1) the emission is a sheet of radius ``R(h)`` and half-width ``w(h)``,
    with the profile ``bump((r² - R²)² / (w² (4 R² + w²)))``: around ``(r - R)² / w²`` where the
    sheet is hollow and smooth across the axis where it closes. The plume is ``bump(r² / W²)``.
    Symmetry is broken by a few per cent: the axis leans and sways, the cross-section is slightly
    elliptic, one side is brighter and the sheet's radius undulates; the seed chooses directions.

    The jet pulses: from time 0 on its emission swings by a third, 250 times a second; pulses
    begin at the nozzle and travel up at 4 m/s, as the undulations of the sheet always do.

    The emission is C², from 0 to about 1.

    Parameters
    ----------
    seed, extent, center, time
        As in :class:`phantoms.FlameField`.
    """

    def _emission(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        sway, lean, bright, oval, puff = 2 * np.pi * np.random.default_rng(self.seed).random(5)
        height = points[:, 1] / REFERENCE_EXTENT[1] + 0.5  # (N,), 0 to 1

        x = points[:, 0] - 0.25 * height**2 * np.cos(2 * np.pi * 1.3 * height + sway)
        x -= 0.2 * height * np.cos(lean)
        z = points[:, 2] - 0.25 * height**2 * np.sin(2 * np.pi * 1.1 * height + sway)
        z -= 0.2 * height * np.sin(lean)
        # r²(1 + e cos 2θ) is a polynomial in x and z, so the ellipse is smooth across the axis.
        square = x * x + z * z
        square += 0.05 * ((x * x - z * z) * np.cos(oval) + 2 * x * z * np.sin(oval))

        radius = (_NOZZLE_RADIUS + _SPREAD * height) * (1 - (height / _TIP) ** 3)
        carried = height - SPEED * self.time / REFERENCE_EXTENT[1]  # where the gas came from
        radius *= 1 + 0.05 * height * np.sin(2 * np.pi * _PUFFS * carried + puff)
        radius = _CLOSING * np.logaddexp(0, radius / _CLOSING)  # positive everywhere, and smooth
        half_width = 1.3 + 0.9 * height
        spread = half_width**2 * (4 * radius**2 + half_width**2)
        sheet = bump((square - radius**2) ** 2 / spread)
        sheet *= 0.6 + 0.2 * smoothstep(height / 0.5)
        sheet *= 1 - smoothstep((height - 0.58) / 0.2)

        plume_radius = 1.0 + 5.5 * height
        plume = 0.4 * bump(square / plume_radius**2)
        plume *= smoothstep((height - 0.4) / 0.35) * (1 - 0.6 * smoothstep((height - 0.65) / 0.35))

        side = (x * np.cos(bright) + z * np.sin(bright)) / np.sqrt(square + 1)
        return (sheet + plume) * (1 + 0.06 * side) * self._pulse(height)

    def _pulse(self, height: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the factor of the pulsing flow, 1 where no pulse has come yet."""
        cycles = _PULSE * (self.time - height * REFERENCE_EXTENT[1] / SPEED)
        return 1 + _PULSE_DEPTH * smoothstep(cycles) * np.sin(2 * np.pi * cycles)


_RADIUS = (1.2, 4.6)  # mm, of the column at the bottom and at the top, where it ends
_SWAY = 1.6  # mm, of the axis at the top
_WAVES = 0.8  # waves of the swaying axis over the height
_PLUME_MODES, _PLUME_WAVELENGTHS = 24, (3.5, 20.0)  # Fourier modes of the brightness; mm


@dataclass(frozen=True)
class Plume(FlameField):
    """A plume that sways: full inside, widening, patchy, with an axis that waves like a flag.

    At height ``h`` (0 to 1) the column is ``bump(r² / R(h)²)`` around an axis that is
    ``1.6 mm h²`` away from the middle, in a direction that turns with height. Its brightness is a
    random field with the spectrum of turbulence, see `phantoms.modes`.

    Puffs rise with the gas at 4 m/s and change within about ten frames of 10 000 a second; the
    wave of the axis travels up with them, 46 times a second past one point.

    The emission is C², from 0 to about 1.

    Parameters
    ----------
    seed, extent, center, time
        As in :class:`phantoms.FlameField`.
    """

    _puffs: Modes = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Draw the modes."""
        super().__post_init__()
        random, motion = np.random.default_rng(self.seed), np.random.default_rng((self.seed, 1))
        modes = Modes.draw(random, _PLUME_MODES, _PLUME_WAVELENGTHS).after(self.time, motion)
        object.__setattr__(self, "_puffs", modes)

    def _emission(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        phase = 2 * np.pi * np.random.default_rng((self.seed, 2)).random()
        height = points[:, 1] / REFERENCE_EXTENT[1] + 0.5  # (N,), 0 to 1
        carried = height - SPEED * self.time / REFERENCE_EXTENT[1]  # where the gas came from
        angle = 2 * np.pi * _WAVES * carried + phase
        away = _SWAY * height**2
        x, z = points[:, 0] - away * np.cos(angle), points[:, 2] - away * np.sin(angle)
        radius = _RADIUS[0] + (_RADIUS[1] - _RADIUS[0]) * height
        column = bump((x * x + z * z) / radius**2)
        column *= 1 - 0.5 * smoothstep((height - 0.3) / 0.7)
        return column * (0.3 + 0.7 / (1 + np.exp(-2.5 * self._puffs.values(points))))


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
