"""Units of light: those of radiance, of emission per volume, and of a volume's total."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Self

from scipy.constants import c, h

from rigs.files.units import metres

_POWERS = {
    "W": 1.0, "kW": 1e3, "MW": 1e6, "mW": 1e-3, "uW": 1e-6, "nW": 1e-9, "photons/s": 1.0,
}  # fmt: skip
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_BANDS = {"": 1.0, "/nm": 1.0, "/um": 1e-3}
"""Spectral densities per nm; without one the light of the whole band counts."""

_SHORT = {"W": "W/m^{}/sr", "photons": "photons/s/m^{}/sr"}
_PATTERN = re.compile(
    rf"({'|'.join(_POWERS)})/({'|'.join(_METRES)})\^?([23])/sr({'|'.join(filter(None, _BANDS))})?"
)


@dataclass(frozen=True)
class LightUnit:
    """A unit of radiance, such as ``W/m^2/sr``, or of emission, such as ``W/m^3/sr``.

    Attributes
    ----------
    power : str
        ``W``, ``kW``, ``MW``, ``mW``, ``uW``, ``nW`` or ``photons/s``.
    length : str
        ``m``, ``cm`` or ``mm``.
    dimension : int
        2: per area; 3: per volume.
    band : str
        ``/nm`` or ``/um`` for spectral densities; empty for the light of the whole band.

    Examples
    --------
    >>> str(LightUnit.of_radiance("mW/cm2/sr/um"))
    'mW/cm^2/sr/um'
    >>> LightUnit.of_emission("photons")
    LightUnit(power='photons/s', length='m', dimension=3, band='')
    """

    power: str
    length: str = "m"
    dimension: int = 2
    band: str = ""

    @classmethod
    def of_radiance(cls, text: str) -> Self:
        """Return the unit of radiance that a text names, or raise ValueError.

        ``W`` and ``photons`` are short names.
        """
        return cls._parsed(text, 2, "of radiance like W/m^2/sr or photons/s/m^2/sr, per nm too")

    @classmethod
    def of_emission(cls, text: str) -> Self:
        """Return the unit of emission that a text names, or raise ValueError.

        ``W`` and ``photons`` are short names.
        """
        return cls._parsed(text, 3, "of emission like W/m^3/sr or photons/s/m^3/sr")

    @classmethod
    def _parsed(cls, text: str, dimension: int, expected: str) -> Self:
        whole = _SHORT.get(text, text).format(dimension).replace("µ", "u").replace("μ", "u")
        found = _PATTERN.fullmatch(whole)
        if found is None or int(found[3]) != dimension:
            raise ValueError(f"found {text!r}, expected a unit {expected}")
        return cls(found[1], found[2], dimension, found[4] or "")

    def __str__(self) -> str:
        """Return the text that files and pages show."""
        return f"{self.power}/{self.length}^{self.dimension}/sr{self.band}"

    @property
    def counts_photons(self) -> bool:
        """Whether light is counted in photons, not in watts."""
        return self.power == "photons/s"

    @property
    def in_si(self) -> float:
        """How many W (or photons/s) per m², m³, sr and nm it is."""
        per_length = _METRES[self.length] ** self.dimension
        return _POWERS[self.power] / per_length * _BANDS[self.band]

    @property
    def emission(self) -> LightUnit:
        """The unit of emission, in metres and per nm, of images in this unit of radiance."""
        power = self.power if self.counts_photons else "W"
        return LightUnit(power, "m", 3, "/nm" if self.band else "")


def images_to_volume(
    radiance: LightUnit, emission: LightUnit, length_unit: str, wavelength: float | None = None
) -> float:
    """Return the factor from a radiance to an integral of emission along a line.

    ``radiance`` is the unit of the images, ``emission`` that of the volume, ``length_unit`` that
    of lengths along a ray: the integral is in ``emission`` times it. The wavelength, in nm, is
    needed between watts and photons.

    Raises
    ------
    ValueError
        If the unit of length has no known size, the wavelength is needed and missing, or only one
        unit is a spectral density.

    Notes
    -----
    A radiance ``L`` is the integral of the emission ``j`` along the ray, ``L = integral j ds``.
    With ``ds`` in ``length_unit`` of ``m`` metres the images become ``L / m`` so that ``j`` comes
    out per cubic metre.

    Examples
    --------
    >>> watts = LightUnit.of_radiance("W")
    >>> images_to_volume(watts, watts.emission, "mm")
    1000.0
    """
    if bool(radiance.band) != bool(emission.band):
        raise ValueError(
            f"volume_unit: found {emission} from images in {radiance}, expected both or neither "
            "per nm: divide by the filter's width, or multiply by it, in radiance or factor"
        )
    factor = radiance.in_si / emission.in_si / metres(length_unit)
    if radiance.counts_photons != emission.counts_photons:
        if wavelength is None:
            raise ValueError(
                f"wavelength: missing, expected it in nm to turn {radiance} into {emission}"
            )
        energy = photon_energy(wavelength)
        factor *= energy if radiance.counts_photons else 1 / energy
    return factor


def photon_energy(wavelength: float) -> float:
    """Return the energy ``h c / wavelength`` of a photon in J; the wavelength is in nm.

    >>> round(photon_energy(500.0) * 1e19, 3)
    3.973
    """
    return h * c / (wavelength * 1e-9)


def unit_of_total(value_unit: str, length_unit: str) -> tuple[str, float]:
    """Return the unit of a volume's integral, and the factor to it from value times volume.

    Examples
    --------
    >>> unit_of_total("W/m^3/sr", "cm")
    ('W/sr', 1e-06)
    >>> unit_of_total("full scales per mm", "mm")
    ('full scales per mm mm^3', 1.0)
    """
    try:
        unit = LightUnit.of_emission(value_unit)
    except ValueError:
        return f"{value_unit} {length_unit}^3".strip(), 1.0
    size = metres(length_unit) / _METRES[unit.length]
    return f"{unit.power}/sr{unit.band}", float(f"{size**3:.15g}")
