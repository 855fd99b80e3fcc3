"""Random fields of plane waves with a turbulent spectrum, still or carried along by the gas."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

SPEED = 4000.0
"""Mean velocity of the gas along +y of the reference box, mm/s: 6.4 voxels of 0.5 mm in 8 frames
at 10 000 frames a second, as of a burner's jet of 4 m/s."""

_LIFE = 1e-3  # s, in which waves of the length below change: ten frames at 10 000 a second
_LIFE_WAVELENGTH = 7.0  # mm


@dataclass(frozen=True, eq=False)
class Modes:
    """A random field ``Σ aₘ cos(kₘ·x + φₘ)`` of mean 0 and variance 1.

    Attributes
    ----------
    wavevectors : (M, 3)
        Radians per mm.
    phases, amplitudes : (M,)
    """

    wavevectors: NDArray[np.float64]
    phases: NDArray[np.float64]
    amplitudes: NDArray[np.float64]

    @classmethod
    def draw(
        cls, random: np.random.Generator, count: int, wavelengths: tuple[float, float]
    ) -> Modes:
        """Return ``count`` modes in random directions, with the inertial range's spectrum."""
        finest, coarsest = wavelengths
        wavenumbers = 2 * np.pi / np.geomspace(coarsest, finest, count)
        along = 2 * random.random(count) - 1
        around = 2 * np.pi * random.random(count)
        across = np.sqrt(1 - along**2)
        directions = np.stack([across * np.cos(around), along, across * np.sin(around)], axis=1)
        amplitudes = wavenumbers ** (-1 / 3)
        amplitudes *= np.sqrt(2 / (amplitudes**2).sum())
        phases = 2 * np.pi * random.random(count)
        return cls(directions * wavenumbers[:, None], phases, amplitudes)

    def after(self, time: float, random: np.random.Generator) -> Modes:
        """Return the field ``time`` seconds later: carried along +y, and changed.

        Parameters
        ----------
        time : float
            Any number; 0 gives the same bits.
        random : numpy.random.Generator
            Draws the frequencies: of one state, for all times of a film.

        Notes
        -----
        ``φₘ(t) = φₘ + (ωₘ - U kₘ,y) t``: every wave travels with the gas at the speed ``U``
        (Taylor's hypothesis), and relative to it by a frequency of its own, drawn from a normal
        distribution of standard deviation ``1 / T(k)``. Seen from the gas, the field at two times
        is correlated by about ``exp(-t² / 2 T²)``: smooth in time, and new after a few ``T``. In
        the inertial range turn-over times go as ``T ∝ k^(-2/3)``: small structures live shortest
        (Pope, "Turbulent Flows", 2000, section 6.1).
        """
        wavenumbers = np.linalg.norm(self.wavevectors, axis=1)
        life = _LIFE * (wavenumbers * _LIFE_WAVELENGTH / (2 * np.pi)) ** (-2 / 3)
        rates = random.standard_normal(len(life)) / life
        return replace(self, phases=self.phases + (rates - SPEED * self.wavevectors[:, 1]) * time)

    def values(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values ``(N,)`` at ``points`` ``(N, 3)``."""
        return np.cos(self._phase(points)) @ self.amplitudes

    def values_and_gradients(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the values ``(N,)`` and the gradients ``(N, 3)`` at ``points`` ``(N, 3)``."""
        phase = self._phase(points)
        gradients = np.sin(phase) @ (-self.amplitudes[:, None] * self.wavevectors)
        return np.cos(phase) @ self.amplitudes, gradients

    def _phase(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return points @ self.wavevectors.T + self.phases  # (N, M)
