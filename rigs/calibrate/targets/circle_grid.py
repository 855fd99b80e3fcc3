"""Grids of circles, symmetric or not: their centres, and their print.

Axes as for the boards in `rigs.calibrate.targets.boards`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.calibrate.targets.flat import Drawn, check_counts, check_length, grid


@dataclass(frozen=True)
class CircleGrid(Drawn):
    """Black circles on white; the points are their centres, the first at (0, 0, 0).

    Parameters
    ----------
    columns, rows : int
        Circles in a row, and rows.
    spacing : float
        Symmetric: distance of neighbours. Asymmetric, as in OpenCV: distance of rows; circles of
        one row are two spacings apart, and every other row is shifted by one.
    asymmetric : bool
        Whether every other row is shifted.
    diameter : float, optional
        Diameter of a circle, for drawing; half the distance of neighbours by default.

    Raises
    ------
    ValueError
        If a field is out of range.

    Notes
    -----
    Symmetric grids, and asymmetric ones with an odd number of rows, are their own mirror images:
    a single image does not show that it was flipped.
    """

    columns: int
    rows: int
    spacing: float
    asymmetric: bool = False
    diameter: float | None = None

    def __post_init__(self) -> None:
        """Check the fields."""
        check_counts(self, 2)
        check_length(self, "spacing")
        neighbour = self.spacing * (math.sqrt(2) if self.asymmetric else 1)
        if self.diameter is None:
            object.__setattr__(self, "diameter", neighbour / 2)
        check_length(self, "diameter")
        if 2 * self._radius >= neighbour:
            raise ValueError(
                f"diameter: found {self.diameter:g}, expected less than the distance "
                f"{neighbour:g} of neighbours"
            )

    def __str__(self) -> str:
        kind = "acircles" if self.asymmetric else "circles"
        return f"{kind}:{self.columns}x{self.rows}:{self.spacing!r}:{self.diameter!r}"

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """``(columns * rows, 3)`` float64, row by row."""
        points = grid(self.columns, self.rows, self.spacing, 0)
        if not self.asymmetric:
            return points
        row = np.repeat(np.arange(self.rows), self.columns)
        points = points * (2.0, 1.0, 1.0)
        points[:, 0] += (row % 2) * self.spacing
        points.flags.writeable = False
        return points

    @property
    def _radius(self) -> float:
        """Half the diameter, which is a number once the fields are checked."""
        assert self.diameter is not None
        return self.diameter / 2

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y) of the drawing: the centres and a margin of one spacing."""
        margin = max(self.spacing, 2 * self._radius)
        return self.points[:, :2].min(axis=0) - margin, self.points[:, :2].max(axis=0) + margin

    @property
    def ambiguity(self) -> str | None:
        """Why an image does not determine the grid's pose, or None."""
        size = f"{self.columns}x{self.rows}"
        if not self.asymmetric:
            angle = 90 if self.columns == self.rows else 180
            return f"a symmetric circle grid of {size} looks the same turned by {angle} degrees"
        if self.rows % 2 == 0:
            return (
                f"an asymmetric circle grid of {size}, with an even number of rows, looks the "
                "same turned by 180 degrees"
            )
        return None

    def brightness(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the print's brightness at target coordinates: 0 is black, 1 white."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        # No circle reaches into another's cell, so only the nearest one matters
        white = np.ones(np.broadcast_shapes(x.shape, y.shape))
        for shift in (0, 1) if self.asymmetric else (0,):
            step = 2 if self.asymmetric else 1
            row = shift + step * np.round((y / self.spacing - shift) / step)
            row = np.clip(row, shift, self.rows - 1 - (self.rows - 1 - shift) % step)
            column = np.clip(np.round((x / self.spacing - shift) / step), 0, self.columns - 1)
            dx = x - (step * column + shift) * self.spacing
            dy = y - row * self.spacing
            white[np.hypot(dx, dy) < self._radius] = 0.0
        return white
