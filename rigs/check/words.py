"""Figures and directions as words."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_ALONG_AXIS = math.cos(math.radians(20.0))
"""Cosine up to which a direction goes by the name of an axis; it says where, not by how much."""


def short(value: float) -> str:
    """Return a number of two digits, without an exponent where it is large."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def direction_words(direction: NDArray[np.float64]) -> str:
    """Return a direction as the name of the axis that it follows, or as a vector."""
    direction = direction * math.copysign(1.0, direction[np.abs(direction).argmax()])
    axis = int(np.abs(direction).argmax())
    if abs(direction[axis]) >= _ALONG_AXIS:
        return "xyz"[axis]
    return "(" + ", ".join(f"{round(value, 1) + 0.0:g}" for value in direction) + ")"
