"""Solids of closed form: what they share, rods and tubes, spheres."""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from rigs.geometry.rotation import numbers
from rigs.scene.surfaces import (
    CYLINDER,
    PLANE,
    SPHERE,
    Glass,
    Material,
    Opaque,
    face,
    index_of,
    perpendicular,
    scaled_material,
)

Vector = tuple[float, float, float]

AROUND = 24
"""Samples round a solid: they find overlaps wider than a twentieth of it."""


class Solid(Protocol):
    """What stands in the light's way."""

    @property
    def name(self) -> str:
        """Unique in a scene."""

    @property
    def material(self) -> Material:
        """The solid's material."""

    def faces(self, medium: float) -> NDArray:
        """Return the table of its faces, `rigs.scene.surfaces.FACE`, in a medium of that index."""

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points ``(N, 3)`` are inside, ``(N,)``."""

    def samples(self) -> NDArray[np.float64]:
        """Return points on its surface, ``(N, 3)``; of an endless one those near its point."""

    @property
    def diameter(self) -> float:
        """Its diameter; the thickness of an endless one."""

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the solid after the motion ``x_new = R @ x_old + t``."""

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the solid of a world whose lengths are ``factor`` times as large."""


class AnalyticSolid:
    """Checks and motions that solids of closed form share; fields say which they have."""

    if TYPE_CHECKING:  # every solid is a dataclass that has these fields
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
        name: str
        material: Material

    _POINTS: ClassVar[tuple[str, ...]] = ()
    _DIRECTIONS: ClassVar[tuple[str, ...]] = ()
    _LENGTHS: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        """Check every field and make vectors plain tuples."""
        if not isinstance(self.name, str) or not self.name.strip():
            raise ValueError(f"solid name: found {self.name!r}, expected text")
        for name in self._POINTS:
            point = numbers(getattr(self, name), (3,), f"{self.what}: {name}")
            object.__setattr__(self, name, tuple(point.tolist()))
        for name in self._DIRECTIONS:
            if getattr(self, name) is None:
                continue
            vector = numbers(getattr(self, name), (3,), f"{self.what}: {name}")
            length = np.linalg.norm(vector)
            if not length > 0:
                raise ValueError(f"{self.what}: {name}: found zeros, expected a direction")
            object.__setattr__(self, name, unit_vector(vector))
        for name in self._LENGTHS:
            length = getattr(self, name)
            if length is None:
                continue
            found = np.atleast_1d(np.asarray(length, float))
            if isinstance(length, bool) or not (found > 0).all():
                raise ValueError(f"{self.what}: {name}: found {length!r}, expected above 0")

    @property
    def what(self) -> str:
        """How messages call the solid."""
        return f"solid {self.name}"

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the solid after the motion ``x_new = R @ x_old + t``."""
        points = {name: tuple(R @ getattr(self, name) + t) for name in self._POINTS}
        turned = {
            name: tuple(R @ getattr(self, name))
            for name in self._DIRECTIONS
            if getattr(self, name) is not None
        }
        return replace(self, **points, **turned)

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the solid of a world whose lengths are ``factor`` times as large."""
        scaled: dict[str, Any] = {}
        for name in (*self._POINTS, *self._LENGTHS):
            value = getattr(self, name)
            if value is not None:
                scaled[name] = (
                    tuple(np.multiply(value, factor)) if np.ndim(value) else value * factor
                )
        return replace(self, material=scaled_material(self.material, factor), **scaled)


def vector_of(array: NDArray[np.float64]) -> Vector:
    """Return the numbers of an array ``(3,)``, as solids hold them."""
    x, y, z = array.tolist()
    return x, y, z


def unit_vector(vector: NDArray[np.float64]) -> Vector:
    """Return a direction at length one; one that is so to rounding stays as a file holds it."""
    length = np.linalg.norm(vector)
    return vector_of(vector if abs(length - 1) < 1e-15 else vector / length)


@dataclass(frozen=True)
class Cylinder(AnalyticSolid):
    """A rod, or the wall of a tube.

    Parameters
    ----------
    name : str
    point : (3,)
        The middle of its axis.
    axis : (3,)
    radius, length : float
    material : Material
    inner_radius : float
        The tube's inner radius; 0 for a rod.
    inside : float or str, optional
        Refractive index of what fills the tube; its ends are then closed by opaque caps. By
        default the scene's medium, and the ends are open.
    """

    name: str
    point: Vector
    axis: Vector
    radius: float
    length: float
    material: Material
    inner_radius: float = 0.0
    inside: float | None = None

    if TYPE_CHECKING:  # an index may be given by name; the field is a number

        def __init__(
            self,
            name: str,
            point: Vector,
            axis: Vector,
            radius: float,
            length: float,
            material: Material,
            inner_radius: float = 0.0,
            inside: float | str | None = None,
        ) -> None: ...

    _POINTS, _DIRECTIONS, _LENGTHS = ("point",), ("axis",), ("radius", "length", "inner_radius")

    def __post_init__(self) -> None:
        """Check every field."""
        if self.inner_radius == 0:
            object.__setattr__(self, "inner_radius", None)
        super().__post_init__()
        if self.inner_radius is not None and not self.inner_radius < self.radius:
            raise ValueError(
                f"{self.what}: inner_radius: found {self.inner_radius!r}, expected below the "
                f"radius {self.radius!r}"
            )
        object.__setattr__(self, "inner_radius", self.inner_radius or 0.0)
        if self.inside is not None:
            index = index_of(self.inside, f"{self.what}: inside")
            object.__setattr__(self, "inside", index)

    @property
    def diameter(self) -> float:
        """Its diameter, or its length where that is more."""
        return float(max(2 * self.radius, self.length if math.isfinite(self.length) else 0))

    def faces(self, medium: float) -> NDArray:
        """Return the table of its faces; see `Solid`."""
        axis, middle = np.array(self.axis), np.array(self.point)
        around, half = (medium, 0.0), (self.length / 2, np.inf)
        table = [
            face(
                CYLINDER, self.material, middle, axis, radius=self.radius, half=half, front=around
            )
        ]
        glass = (
            (self.material.index, self.material.extinction)
            if isinstance(self.material, Glass)
            else around
        )
        filled = (medium if self.inside is None else self.inside, 0.0)
        if self.inner_radius > 0:
            table.append(
                face(
                    CYLINDER, self.material, middle, axis, radius=self.inner_radius, half=half,
                    front=glass, behind=filled,
                )
            )  # fmt: skip
        if not math.isfinite(self.length):
            return np.concatenate(table)
        for sign in (-1, 1):
            end, out = middle + sign * self.length / 2 * axis, sign * axis
            table.append(
                face(
                    PLANE, self.material, end, out, radius=self.radius, hole=self.inner_radius,
                    front=around,
                )
            )  # fmt: skip
            if self.inner_radius > 0 and self.inside is not None:
                table.append(face(PLANE, Opaque(), end, out, radius=self.inner_radius))
        return np.concatenate(table)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are in the wall or rod; see `Solid`."""
        along, out = self._cylindrical(points)
        return (np.abs(along) < self.length / 2) & (out < self.radius) & (out > self.inner_radius)

    def samples(self) -> NDArray[np.float64]:
        """Return points on the wall, outside and inside; see `Solid`."""
        axis = np.array(self.axis)
        first = perpendicular(axis)
        second = np.cross(axis, first)
        turn = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
        circle = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
        length = self.length if math.isfinite(self.length) else 4 * self.radius
        along = np.linspace(-0.5, 0.5, AROUND)[:, None, None] * length * axis
        radii = {self.radius, self.inner_radius} - {0.0}
        return np.array(self.point) + np.concatenate(
            [(along + radius * circle).reshape(-1, 3) for radius in sorted(radii)]
        )

    def _cylindrical(self, points: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return positions along the axis and distances from it, ``(N,)`` each."""
        away = points - np.array(self.point)
        along = away @ np.array(self.axis)
        return along, np.linalg.norm(away - along[:, None] * np.array(self.axis), axis=1)


@dataclass(frozen=True)
class Sphere(AnalyticSolid):
    """A ball.

    Parameters
    ----------
    name : str
    center : (3,)
    radius : float
    material : Material
    """

    name: str
    center: Vector
    radius: float
    material: Material

    _POINTS, _LENGTHS = ("center",), ("radius",)

    @property
    def diameter(self) -> float:
        """Its diameter."""
        return 2 * self.radius

    def faces(self, medium: float) -> NDArray:
        """Return the table of its face; see `Solid`."""
        return face(SPHERE, self.material, self.center, radius=self.radius, front=(medium, 0.0))

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are inside; see `Solid`."""
        return np.linalg.norm(points - np.array(self.center), axis=1) < self.radius

    def samples(self) -> NDArray[np.float64]:
        """Return points on the surface (Fibonacci lattice); see `Solid`."""
        n = AROUND**2
        z = 1 - (2 * np.arange(n) + 1) / n
        turn = np.pi * (3 - math.sqrt(5)) * np.arange(n)
        out = np.sqrt(1 - z**2)
        unit = np.stack([out * np.cos(turn), out * np.sin(turn), z], axis=1)
        return np.array(self.center) + self.radius * unit
