"""A jet flame: a smooth, slender, nearly axisymmetric sheet of light with a plume above it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phantoms.field import REFERENCE_EXTENT, FlameField, bump, smoothstep
from phantoms.modes import SPEED

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
