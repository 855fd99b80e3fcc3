"""Fields in space, and the box that phantoms fill."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Edge lengths in mm of the box in which flames are defined; other boxes hold them stretched.
REFERENCE_EXTENT = (15.0, 70.0, 15.0)

_POINTS_AT_ONCE = 4096  # more leave a core's cache
_MARGIN = 1 / 30  # of the extent, dark at each face: one 0.5 mm voxel across the reference box
_RAMP = 1 / 12  # of the extent, over which emission grows from the dark margin to its full value


class Field(Protocol):
    """Anything that gives an emission, >= 0, at every point of space."""

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the values ``(...)`` at ``points`` ``(..., 3)`` in world coordinates."""
        ...


@runtime_checkable
class MovingField(Field, Protocol):
    """A field that changes with time."""

    def at(self, time: float) -> Field:
        """Return the field at a time in seconds."""
        ...


def field_at(field: Field, time: float) -> Field:
    """Return a field at a time in seconds; one that does not move is the same at all times."""
    return field.at(time) if isinstance(field, MovingField) else field


@dataclass(frozen=True)
class BoxField(ABC):
    """A family of fields in a box; a seed selects the member.

    Subclasses are defined in the reference box of 15 x 70 x 15 mm centred at the origin, with the
    flame's axis along +y. Any other box holds the same field, stretched.

    Parameters
    ----------
    seed : int
        Selects the member of the family; equal seeds give bit-identical fields.
    extent : (float, float, float)
        Edge lengths of the box in world units.
    center : (float, float, float)
        The middle of the box in world coordinates.

    Raises
    ------
    ValueError
        If the seed is not a whole number >= 0, or an edge length is not positive.
    """

    seed: int = 0
    extent: tuple[float, float, float] = REFERENCE_EXTENT
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Normalise to plain numbers, so that fields compare, hash and print as values."""
        name = type(self).__name__
        object.__setattr__(self, "seed", checked_seed(name, self.seed))
        extent, center = checked_box(name, self.extent, self.center)
        object.__setattr__(self, "extent", extent)
        object.__setattr__(self, "center", center)

    @abstractmethod
    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the emission ``(...)``, float64, at ``points`` ``(..., 3)``."""

    def _in_extents(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``points`` ``(..., 3)`` in extents from the middle; faces are at ±1/2."""
        return (points - self.center) / self.extent


@dataclass(frozen=True)
class FlameField(BoxField):
    """A smooth field in a box that fades to zero before it reaches the faces, and that moves.

    The emission is multiplied by a C² window that is exactly zero outside the box and within 1/30
    of the extent from each face, and one from 7/60 of the extent inwards.

    Parameters
    ----------
    seed, extent, center
        As in `BoxField`.
    time : float
        Seconds; the still phantom is that of time 0. The field is smooth in time.

    Raises
    ------
    ValueError
        As of `BoxField`, or if the time is not finite.
    """

    time: float = 0.0

    def __post_init__(self) -> None:
        """Check the time too."""
        super().__post_init__()
        if not np.isfinite(self.time):
            raise ValueError(f"{type(self).__name__} time: found {self.time}, expected a number")
        object.__setattr__(self, "time", float(self.time))

    def at(self, time: float) -> Self:
        """Return the same flame at another time, in seconds."""
        return replace(self, time=time)

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the emission ``(...)``, float64, at ``points`` ``(..., 3)``."""
        points = as_points(points)
        flat = points.reshape(-1, 3)
        values = np.zeros(len(flat))
        for start in range(0, len(flat), _POINTS_AT_ONCE):
            part = slice(start, start + _POINTS_AT_ONCE)
            unit = self._in_extents(flat[part])
            window = _window(unit)
            lit = window > 0
            if lit.any():
                emission = self._emission(unit[lit] * REFERENCE_EXTENT)
                values[part][lit] = emission * window[lit]
        return values.reshape(points.shape[:-1])

    @abstractmethod
    def _emission(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the emission ``(N,)`` at ``points`` ``(N, 3)`` of the reference box."""


def as_points(points: ArrayLike) -> NDArray[np.float64]:
    """Return ``points`` as float64, or raise if the last axis is not of length 3."""
    points = np.asarray(points, np.float64)
    if points.ndim < 1 or points.shape[-1] != 3:
        raise ValueError(f"points: found shape {points.shape}, expected (..., 3)")
    return points


def checked_seed(name: str, seed: int) -> int:
    """Return ``seed`` as a plain int, or raise a ValueError that names the field."""
    if int(seed) != seed or seed < 0:
        raise ValueError(f"{name} seed: found {seed!r}, expected a whole number >= 0")
    return int(seed)


def checked_box(
    name: str, extent: ArrayLike, center: ArrayLike
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return a box as plain tuples, or raise a ValueError that names the field."""
    edges, middle = np.asarray(extent, np.float64), np.asarray(center, np.float64)
    if edges.shape != (3,) or not (np.isfinite(edges).all() and (edges > 0).all()):
        raise ValueError(f"{name} extent: found {extent!s}, expected three positive lengths")
    if middle.shape != (3,) or not np.isfinite(middle).all():
        raise ValueError(f"{name} center: found {center!s}, expected three finite numbers")
    (width, height, depth), (x, y, z) = edges.tolist(), middle.tolist()
    return (width, height, depth), (x, y, z)


def smoothstep(x: ArrayLike) -> NDArray[np.float64]:
    """Return 0 below 0, 1 above 1 and between them ``6x⁵ - 15x⁴ + 10x³``, which is C²."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (x * (6.0 * x - 15.0) + 10.0)


def bump(square: ArrayLike) -> NDArray[np.float64]:
    """Return the C³ profile ``(1 - u²)⁴`` for ``u² = square`` below 1, and exactly 0 beyond.

    Its full width at half maximum is 0.798 in ``u``. Its support is compact, unlike a Gaussian's:
    dark parts of a flame, and of its images, are exactly zero.
    """
    inside = np.maximum(1.0 - np.asarray(square), 0.0)
    inside = inside * inside
    return inside * inside


def _window(unit: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the window ``(N,)``, zero at the faces; ``unit`` ``(N, 3)`` is in extents."""
    depth = (0.5 - _MARGIN - np.abs(unit)) / _RAMP
    return smoothstep(depth).prod(axis=-1)
