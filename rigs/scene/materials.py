"""What solids of a scene are made of, and refractive indices by name."""

from __future__ import annotations

import math
from dataclasses import dataclass

INDICES = {
    "vacuum": 1.0,
    "air": 1.00027,
    "water": 1.3330,
    "quartz": 1.4585,
    "acrylic": 1.4917,
    "bk7": 1.5168,
    "sapphire": 1.7682,
}
"""Indices at the yellow sodium line (589 nm), at 20 degrees Celsius; sapphire's ordinary ray.

Sources: Malitson 1965 (fused quartz), Malitson 1962 (sapphire), Schott's data sheet (BK7),
Sultanova 2009 (acrylic), IAPWS 1997 (water), Ciddor 1996 (air).
"""


def index_of(value: float | str, what: str) -> float:
    """Return a refractive index, given as a number or by a name of `INDICES`.

    Raises
    ------
    ValueError
        Naming ``what``, if it is neither a known name nor a finite number of at least 1.
    """
    if isinstance(value, str):
        if value not in INDICES:
            raise ValueError(
                f"{what}: found {value!r}, expected a number or one of {', '.join(INDICES)}"
            )
        return INDICES[value]
    if isinstance(value, bool) or not (1 <= value < math.inf):
        raise ValueError(f"{what}: found {value!r}, expected a refractive index of at least 1")
    return float(value)


@dataclass(frozen=True)
class Opaque:
    """Light ends here."""


@dataclass(frozen=True)
class Reflecting:
    """A mirror's surface.

    Parameters
    ----------
    reflectivity : float
        Fraction of the light that is reflected, above 0 up to 1.
    """

    reflectivity: float = 1.0

    def __post_init__(self) -> None:
        """Check the fraction."""
        if not 0 < self.reflectivity <= 1:
            raise ValueError(
                f"reflectivity: found {self.reflectivity!r}, expected a fraction above 0 up to 1"
            )


@dataclass(frozen=True)
class Glass:
    """Light is refracted at the surface and passes.

    Parameters
    ----------
    index : float or str
        Refractive index, or its name in `INDICES`.
    extinction : float
        Coefficient ``k`` in 1 / length: of the light ``exp(-k l)`` is left behind the length l.
    """

    index: float
    extinction: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        object.__setattr__(self, "index", index_of(self.index, "index"))
        if not 0 <= self.extinction < math.inf:
            raise ValueError(
                f"extinction: found {self.extinction!r}, expected a number of at least 0"
            )


Material = Opaque | Reflecting | Glass
