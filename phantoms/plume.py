"""A plume of lit gas: a widening column that sways, with puffs that rise in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from phantoms.field import REFERENCE_EXTENT, FlameField, bump, smoothstep
from phantoms.modes import SPEED, Modes

_RADIUS = (1.2, 4.6)  # mm, of the column at the bottom and at the top, where it ends
_SWAY = 1.6  # mm, of the axis at the top
_WAVES = 0.8  # waves of the swaying axis over the height
_PUFFS, _PUFF_WAVELENGTHS = 24, (3.5, 20.0)  # Fourier modes of the brightness; mm


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
        modes = Modes.draw(random, _PUFFS, _PUFF_WAVELENGTHS).after(self.time, motion)
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
