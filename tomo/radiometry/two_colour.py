"""Two-colour pyrometry: temperatures of soot from its emission at two wavelengths.

Thermal light follows Planck's law; its ratio at two wavelengths gives the temperature.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.constants import c, h, k

SECOND_CONSTANT = h * c / k * 1e9
"""Second radiation constant ``h c / k`` in nm K."""


def planck_radiance(wavelength: ArrayLike, temperature: ArrayLike) -> NDArray[np.float64]:
    """Return a black body's radiance in W/m^2/sr/nm at wavelengths in nm, temperatures in K.

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
    first = 2e-9 * h * c**2 / (wavelength * 1e-9) ** 5
    with np.errstate(over="ignore"):  # far in the ultraviolet a cold body sends nothing
        return first / np.expm1(exponent)


def log_ratio(
    inverse: NDArray[np.float64], wavelengths: tuple[float, float], exponent: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the logarithm of the ratio of emissions, first over second, and its slope.

    ``ln R = (5 + a) ln(w2 / w1) + ln(exp(c / (w2 T)) - 1) - ln(exp(c / (w1 T)) - 1)`` with
    ``inverse`` ``1 / T`` in 1/K, above 0, the wavelengths ``w`` in nm, absorption proportional to
    ``wavelength^-a``, and the second radiation constant ``c``. Wien's approximation leaves out
    both ``- 1``.
    """
    value = np.full_like(inverse, (5 + exponent) * np.log(wavelengths[1] / wavelengths[0]))
    slope = np.zeros_like(inverse)
    for sign, wavelength in zip((-1, 1), wavelengths, strict=True):
        rate = SECOND_CONSTANT / wavelength
        rest = -np.expm1(-rate * inverse)  # 1 - exp(-c / (w T))
        value += sign * (rate * inverse + np.log(rest))
        slope += sign * rate / rest
    return value, slope


STEPS = 50
"""Newton steps at most: up to 10 are needed, at ratios just below the largest possible one."""

FAINT = 0.05
"""Fraction of the brightest voxel below which a volume's ratio means nothing by default. Lower,
noise and smoothing set the ratio; higher, the flame's edge is lost."""

Temperatures = tuple[NDArray[np.float64], NDArray[np.float64]]


def temperature_from_ratio(
    ratio: ArrayLike,
    wavelengths: tuple[float, float],
    *,
    relative_deviation: ArrayLike = 0.0,
    exponent: float = 0.0,
) -> Temperatures:
    """Return the temperature whose thermal emission has a ratio at two wavelengths.

    Parameters
    ----------
    ratio : array
        Spectral emission at the first wavelength over that at the second one, both per nm: of
        filters of other widths, divide each emission by its width first.
    wavelengths : (first, second)
        In nm.
    relative_deviation : array
        Standard deviation of the ratio over the ratio.
    exponent : float
        The emissivity is proportional to ``wavelength^-exponent``: 0 is grey; 1 is soot of
        particles much smaller than the wavelength whose refractive index does not change.

    Returns
    -------
    temperature : array
        In K. NaN where the ratio is none of a hot body: not above 0, not finite, or beyond that
        of endless temperature.
    deviation : array
        Its standard deviation in K.

    Raises
    ------
    ValueError
        If the wavelengths are equal or not above 0, or a deviation is below 0.

    Notes
    -----
    Planck's law without Wien's approximation, solved for ``1 / T`` by Newton's method, see
    `tomo.radiometry.two_colour.log_ratio`. To first order

    ``s_T = T (s_R / R) / |x1 / (1 - exp(-x1)) - x2 / (1 - exp(-x2))|``, ``x = h c / (w k T)``.

    Examples
    --------
    >>> from tomo.radiometry import planck_radiance
    >>> ratio = planck_radiance(550.0, 1800.0) / planck_radiance(700.0, 1800.0)
    >>> temperature, deviation = temperature_from_ratio(
    ...     ratio, (550.0, 700.0), relative_deviation=0.02
    ... )
    >>> print(f"{temperature:.1f} +- {deviation:.1f} K")
    1800.0 +- 11.6 K
    """
    first, second = _checked(wavelengths)
    relative_deviation = np.asarray(relative_deviation, np.float64)
    if (relative_deviation < 0).any():
        found = float(relative_deviation.min())
        raise ValueError(f"relative_deviation: found {found:g}, expected 0 or more")
    ratio = np.asarray(ratio, np.float64)
    hottest = (4 + exponent) * math.log(second / first)  # of Rayleigh and Jeans, 1 / T = 0
    # the emission at the shorter wavelength grows faster with the temperature
    sign = 1 if first < second else -1
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.log(ratio)
        known = np.isfinite(wanted) & (sign * (hottest - wanted) > 0)
    wanted = np.where(known, wanted, hottest - sign)
    inverse = np.full_like(wanted, 1e-3)
    for _ in range(STEPS):
        value, slope = log_ratio(inverse, (first, second), exponent)
        moved = np.maximum(inverse - (value - wanted) / slope, inverse / 10)
        change = np.abs(moved - inverse).max(initial=0.0, where=known) if moved.size else 0.0
        inverse = moved
        if change <= 1e-14 * inverse.min(initial=1.0, where=known):
            break
    _, slope = log_ratio(inverse, (first, second), exponent)
    # T = 1 / u, so that s_T = s_u / u^2 and s_u = (s_R / R) / |d ln R / du|
    deviation = relative_deviation / np.abs(slope) / inverse**2
    nothing = np.where(known, 0.0, np.nan)
    return 1 / inverse + nothing, deviation + nothing


def temperature_of_volumes(
    first: ArrayLike,
    second: ArrayLike,
    wavelengths: tuple[float, float],
    *,
    deviations: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
    calibration: float = 0.0,
    exponent: float = 0.0,
    faint: float = FAINT,
) -> Temperatures:
    """Return the temperature in every voxel of two volumes of spectral emission.

    Parameters
    ----------
    first, second : (nx, ny, nz)
        Emission per nm at both wavelengths, in one unit.
    wavelengths : (first, second)
        In nm.
    deviations : pair of (nx, ny, nz)
        Standard deviations of both volumes, see ``--uncertainty`` and `tomo.uncertainty`.
    calibration : float
        Relative standard deviation of the ratio of both calibrations: common to all voxels.
    exponent : float
        See `temperature_from_ratio`.
    faint : float
        Voxels below this fraction of the brightest one, in either volume, are NaN.

    Returns
    -------
    temperature, deviation : (nx, ny, nz) float64
        In K.

    Raises
    ------
    ValueError
        If the volumes differ in shape, and see `temperature_from_ratio`.

    Notes
    -----
    ``(s_R / R)^2 = (s_1 / j_1)^2 + (s_2 / j_2)^2 + calibration^2``: noise of both scans is
    independent. A temperature of a voxel weighs its hot soot more: it is a mean of the emission.
    """
    first, second = (np.asarray(one, np.float64) for one in (first, second))
    if first.shape != second.shape:
        raise ValueError(
            f"second: found shape {second.shape}, expected {first.shape} of the first"
        )
    lit = np.isfinite(first) & np.isfinite(second)
    for one in (first, second):
        lit &= one > max(faint * one.max(initial=0.0, where=np.isfinite(one)), 0.0)
    safe = [np.where(lit, one, 1.0) for one in (first, second)]
    squares = [(s / one) ** 2 for s, one in zip(deviations, safe, strict=True)]
    return temperature_from_ratio(
        np.where(lit, safe[0] / safe[1], np.nan),
        wavelengths,
        relative_deviation=np.sqrt(sum(squares) + calibration**2),
        exponent=exponent,
    )


def _checked(wavelengths: tuple[float, float]) -> tuple[float, float]:
    first, second = (float(one) for one in wavelengths)
    if not (first > 0 and second > 0 and math.isfinite(first + second)) or first == second:
        raise ValueError(
            f"wavelengths: found {first:g} and {second:g}, expected two different ones in nm"
        )
    return first, second
