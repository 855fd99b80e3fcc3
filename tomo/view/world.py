"""From the world's lengths to those of the page, which draws in float32 between near and far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.view.content import Content


@dataclass(frozen=True, eq=False)
class World:
    """The page's coordinates: the target's middle is zero, its radius is one.

    Attributes
    ----------
    middle : (3,) float64
    unit : float
        World length of one unit of the page.
    reach : float
        Distance of what is farthest from the middle, in the page's units.
    """

    middle: NDArray[np.float64]
    unit: float
    reach: float

    @classmethod
    def of(cls, content: Content) -> World:
        """Return the coordinates in which some content is drawn."""
        target = content.target
        return cls(target.center, target.radius, content.reach / target.radius)

    def points(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return world points ``(..., 3)`` in the page's coordinates."""
        return (np.asarray(points, np.float64) - self.middle) / self.unit

    def back(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the page's points ``(..., 3)`` in the world's coordinates."""
        return np.asarray(points, np.float64) * self.unit + self.middle
