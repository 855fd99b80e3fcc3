"""Thermal light: Planck's law and its ratio at two wavelengths."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.radiometry.units import PLANCK, SPEED_OF_LIGHT

BOLTZMANN = 1.380649e-23
"""Boltzmann's constant in J/K, exact in the SI."""

SECOND_CONSTANT = PLANCK * SPEED_OF_LIGHT / BOLTZMANN * 1e9
"""Second radiation constant ``h c / k`` in nm K."""


def planck_radiance(wavelength: ArrayLike, temperature: ArrayLike) -> NDArray[np.float64]:
    """Return the spectral radiance of a black body in W/m^2/sr/nm.

    Parameters
    ----------
    wavelength : array
        In nm.
    temperature : array
        In K.

    Notes
    -----
    ``B = 2 h c^2 / wavelength^5 / (exp(h c / (wavelength k T)) - 1)`` (Planck 1900). Gas of
    absorption coefficient ``kappa`` that is thin enough to let its light out emits
    ``j = kappa B`` in W/m^3/sr/nm (Kirchhoff).

    Examples
    --------
    >>> print(f"{planck_radiance(650.0, 1800.0):.4g}")
    4.685
    """
    wavelength = np.asarray(wavelength, np.float64)
    exponent = SECOND_CONSTANT / (wavelength * np.asarray(temperature, np.float64))
    first = 2e-9 * PLANCK * SPEED_OF_LIGHT**2 / (wavelength * 1e-9) ** 5
    with np.errstate(over="ignore"):  # far in the ultraviolet a cold body sends nothing
        return first / np.expm1(exponent)


def log_ratio(
    inverse: NDArray[np.float64], wavelengths: tuple[float, float], exponent: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the logarithm of the emission's ratio at two wavelengths, and its slope.

    Parameters
    ----------
    inverse : array
        ``1 / T`` in 1/K, above 0; the slope is that by it.
    wavelengths : (first, second)
        In nm: the ratio is first over second.
    exponent : float
        The absorption coefficient is proportional to ``wavelength^-exponent``.

    Notes
    -----
    ``ln R = (5 + a) ln(w2 / w1) + ln(exp(c / (w2 T)) - 1) - ln(exp(c / (w1 T)) - 1)`` with the
    second radiation constant ``c``. Wien's approximation leaves out both ``- 1``.
    """
    value = np.full_like(inverse, (5 + exponent) * np.log(wavelengths[1] / wavelengths[0]))
    slope = np.zeros_like(inverse)
    for sign, wavelength in zip((-1, 1), wavelengths, strict=True):
        rate = SECOND_CONSTANT / wavelength
        rest = -np.expm1(-rate * inverse)  # 1 - exp(-c / (w T))
        value += sign * (rate * inverse + np.log(rest))
        slope += sign * rate / rest
    return value, slope
