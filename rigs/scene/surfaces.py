"""What solids are made of, and their faces as rows of one table, which the tracer reads.

A face knows the medium on both of its sides. Its front is the side that its normal points to: the
outside of a cylinder or a sphere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
            raise ValueError(f"reflectivity: found {self.reflectivity}, expected above 0 up to 1")


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
            raise ValueError(f"extinction: found {self.extinction!r}, expected a number >= 0")


Material = Opaque | Reflecting | Glass


def scaled_material(material: Material, factor: float) -> Material:
    """Return the material of a world whose lengths are ``factor`` times as large."""
    if isinstance(material, Glass):
        return replace(material, extinction=material.extinction / factor)
    return material


PLANE, CYLINDER, SPHERE, TRIANGLE = range(4)
BLOCKS, REFLECTS, REFRACTS = range(3)

FACE = np.dtype(
    [
        ("kind", np.int64),
        ("action", np.int64),
        ("solid", np.int64),
        ("point", np.float64, (3,)),  # on the plane, on the axis, or the centre
        ("axis", np.float64, (3,)),  # the plane's normal or the cylinder's axis
        ("across", np.float64, (3,)),  # along the first side of a rectangle
        ("upward", np.float64, (3,)),  # along the second
        ("radius", np.float64),  # of the disc, the cylinder or the sphere
        ("hole", np.float64),  # radius of the hole in a disc
        ("half", np.float64, (2,)),  # half the sides of a rectangle; half a cylinder's length
        ("index", np.float64, (2,)),  # refractive index in front and behind
        ("extinction", np.float64, (2,)),  # in front and behind, 1 / length
        ("reflectivity", np.float64),
    ]
)
"""A face; lengths in the rig's unit. One row of kind TRIANGLE stands for a whole mesh."""


def face(
    kind: int,
    material: Material,
    point: ArrayLike,
    axis: ArrayLike = (0.0, 0.0, 1.0),
    *,
    radius: float = np.inf,
    hole: float = 0.0,
    across: ArrayLike | None = None,
    half: tuple[float, float] = (np.inf, np.inf),
    front: tuple[float, float] = (1.0, 0.0),
    behind: tuple[float, float] | None = None,
) -> NDArray:
    """Return a row of the table, ``(1,)`` of `FACE`, whose fields the others are.

    ``axis`` is a unit vector; ``front, behind`` are a side's index and extinction, by default
    glass's.
    """
    row = np.zeros(1, FACE)
    row["kind"], row["point"], row["axis"] = kind, point, axis
    row["radius"], row["hole"], row["half"] = radius, hole, half
    row["across"] = perpendicular(np.asarray(axis, float)) if across is None else across
    row["upward"] = np.cross(row["axis"], row["across"])
    if behind is None:
        behind = (material.index, material.extinction) if isinstance(material, Glass) else front
    row["index"] = front[0], behind[0]
    row["extinction"] = front[1], behind[1]
    row["action"] = {Opaque: BLOCKS, Reflecting: REFLECTS, Glass: REFRACTS}[type(material)]
    row["reflectivity"] = material.reflectivity if isinstance(material, Reflecting) else 1.0
    return row


def perpendicular(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a unit vector across ``axis``, ``(3,)``."""
    across = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    return across / np.linalg.norm(across)
