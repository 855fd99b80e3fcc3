"""Common parts of flat targets: print, points in rows, checks of fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MAX_POINTS = 100_000  # of a target; more are a typing error and take memory
_MAX_PIXELS = 400_000_000  # of a drawing; more take more than 400 MB


class Drawn:
    """A target that is drawn from its `brightness`."""

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y) of the drawing; each kind of target has its own."""
        raise NotImplementedError

    def brightness(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the print's brightness at target coordinates: 0 is black, 1 white."""
        raise NotImplementedError

    def drawing(self, pixels_per_unit: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """Return the target as an image ``(rows, columns)`` uint8 for print, with a white margin.

        Parameters
        ----------
        pixels_per_unit : float
            Pixels in one length unit of the target. Every pixel shows the target at its centre:
            edges are exact to half a pixel.

        Returns
        -------
        image : (rows, columns) uint8
            0 is black, 255 white; 400 megapixels at most.
        origin : (2,) float64
            The outer corner of the image's first pixel in the target's x and y: the centre of
            pixel (row, column) lies at ``origin + (column + 0.5, row + 0.5) / pixels_per_unit``.
        """
        low, high = self.extent
        count = np.asarray(high - low) * pixels_per_unit
        if not (pixels_per_unit > 0 and np.isfinite(count).all() and count.min() >= 1):
            raise ValueError(
                f"pixels_per_unit: found {pixels_per_unit:g}, expected a positive number that "
                "gives at least one pixel"
            )
        columns, rows = (math.ceil(size - 1e-6) for size in count)
        if columns * rows > _MAX_PIXELS:
            raise ValueError(
                f"pixels_per_unit: found {pixels_per_unit:g}, which makes {columns} x {rows} "
                "pixels, expected at most 400 megapixels"
            )
        x = low[0] + (np.arange(columns) + 0.5) / pixels_per_unit
        y = low[1] + (np.arange(rows) + 0.5) / pixels_per_unit
        image = np.zeros((rows, columns), np.uint8)
        for start in range(0, rows, 64):  # strips: float64 coordinates need eight times the memory
            strip = slice(start, start + 64)
            image[strip] = 255 * self.brightness(x[None, :], y[strip, None])
        return image, np.array(low)


def check_counts(target: Any, least: int) -> None:
    """Raise unless ``columns`` and ``rows`` are integers of at least ``least``."""
    for name in ("columns", "rows"):
        count = getattr(target, name)
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < least:
            raise ValueError(f"{name}: found {count!r}, expected an integer of at least {least}")
        object.__setattr__(target, name, int(count))
    if target.columns * target.rows > _MAX_POINTS:
        raise ValueError(
            f"columns: found {target.columns}x{target.rows}, expected at most {_MAX_POINTS} points"
        )


def check_length(target: Any, name: str) -> None:
    """Raise unless the field called ``name`` is a positive length."""
    length = getattr(target, name)
    if not (isinstance(length, (int, float, np.number)) and math.isfinite(length) and length > 0):
        raise ValueError(f"{name}: found {length!r}, expected a positive length")
    object.__setattr__(target, name, float(length))


def grid(columns: int, rows: int, step: float, first: int) -> NDArray[np.float64]:
    """Return ``(columns * rows, 3)`` points of z = 0, row by row, read-only."""
    row, column = np.mgrid[first : first + rows, first : first + columns]
    points = np.stack([column.ravel() * step, row.ravel() * step, np.zeros(row.size)], axis=-1)
    points.flags.writeable = False
    return points


def is_among(index: NDArray[np.float64], count: int) -> NDArray[np.bool_]:
    """Return which indices are from 0 to ``count - 1``."""
    return (index >= 0) & (index < count)
