"""What is known of a window beforehand: how far its pose and thickness may be adjusted."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Self


@dataclass(frozen=True)
class WindowPrior:
    """Standard deviations of a window's given pose and thickness; what has none is held.

    Parameters
    ----------
    name : str
        The window's, in the scene.
    normal : float
        Of its direction, each way, in degrees.
    distance : float
        Of its place along the normal, in the rig's length unit.
    thickness : float
        In the rig's length unit.

    Raises
    ------
    ValueError
        If a number is negative or all are zero.

    Examples
    --------
    >>> WindowPrior.parsed("quartz:normal=2,thickness=0.1")
    WindowPrior(name='quartz', normal=2.0, distance=0.0, thickness=0.1)
    """

    name: str
    normal: float = 0.0
    distance: float = 0.0
    thickness: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        values = (self.normal, self.distance, self.thickness)
        if not all(0 <= value < math.inf for value in values) or not any(values):
            raise ValueError(
                f"window {self.name}: found standard deviations {values}, expected those of what "
                "is adjusted: normal (degrees), distance, thickness"
            )

    @property
    def deviations(self) -> tuple[float, float, float, float]:
        """Those of its four numbers: two tilts in radians, distance, thickness."""
        tilt = math.radians(self.normal)
        return tilt, tilt, self.distance, self.thickness

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Return the prior of a text ``NAME:normal=2,distance=1,thickness=0.1``.

        Raises
        ------
        ValueError
            Naming the text.
        """
        name, _, values = text.rpartition(":")
        known = [field.name for field in fields(cls)[1:]]
        found = {}
        for part in values.split(","):
            key, _, number = part.partition("=")
            try:
                found[key.strip()] = float(number)
            except ValueError:
                found[""] = 0.0
        if not name.strip() or not set(found) <= set(known):
            raise ValueError(
                f"found {text!r}, expected NAME:normal=DEGREES,distance=LENGTH,thickness=LENGTH, "
                "the standard deviations of what is adjusted of a window"
            )
        return cls(name.strip(), **found)
