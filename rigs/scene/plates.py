"""Plates: windows and plane mirrors, round, rectangular or endless."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.scene.materials import Glass, Opaque, Reflecting, index_of
from rigs.scene.solids import AROUND, AnalyticSolid, Vector, unit_vector
from rigs.scene.surfaces import CYLINDER, PLANE, face, perpendicular


@dataclass(frozen=True)
class Window(AnalyticSolid):
    """A plane-parallel plate; its rim is opaque.

    Parameters
    ----------
    name : str
    point : (3,)
        The middle of its first face.
    normal : (3,)
        Out of that face, away from the plate.
    thickness : float
        The second face lies ``thickness`` against the normal.
    material : Glass
    beyond : float or str, optional
        Refractive index of the medium beyond the second face; by default the scene's.
    size : float or (float, float), optional
        Diameter of a round window, or the sides of a rectangular one; endless by default.
    across : (3,), optional
        Direction of a rectangular window's first side, made perpendicular to the normal.
    """

    name: str
    point: Vector
    normal: Vector
    thickness: float
    material: Glass
    beyond: float | None = None
    size: float | tuple[float, float] | None = None
    across: Vector | None = None

    if TYPE_CHECKING:  # an index may be given by name; the field is a number

        def __init__(
            self,
            name: str,
            point: Vector,
            normal: Vector,
            thickness: float,
            material: Glass,
            beyond: float | str | None = None,
            size: float | tuple[float, float] | None = None,
            across: Vector | None = None,
        ) -> None: ...

    _POINTS, _DIRECTIONS = ("point",), ("normal", "across")
    _LENGTHS = ("thickness", "size")

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        if not isinstance(self.material, Glass):
            raise ValueError(f"{self.what}: material: found {self.material!r}, expected glass")
        if not math.isfinite(self.thickness):
            raise ValueError(
                f"{self.what}: thickness: found {self.thickness!r}, expected a length"
            )
        if self.beyond is not None:
            index = index_of(self.beyond, f"{self.what}: beyond")
            object.__setattr__(self, "beyond", index)
        _check_across(self)

    @property
    def diameter(self) -> float:
        """Its diameter; the thickness of an endless one."""
        return self.thickness if self.size is None else float(np.linalg.norm(self.size))

    def faces(self, medium: float) -> NDArray:
        """Return the table of its faces; see `Solid`."""
        normal, point = np.array(self.normal), np.array(self.point)
        second = point - self.thickness * normal
        across, radius, half = _outline(self)
        glass = (self.material.index, self.material.extinction)
        beyond = (medium if self.beyond is None else self.beyond, 0.0)
        table = [
            face(
                PLANE, self.material, place, normal,
                front=front, behind=behind, across=across, radius=radius, half=half,
            )
            for place, front, behind in ((point, (medium, 0.0), None), (second, glass, beyond))
        ]  # fmt: skip
        middle = (point + second) / 2
        if isinstance(self.size, tuple):
            sides = (across, np.cross(normal, across))
            for side, length, other in zip(sides, self.size, self.size[::-1], strict=True):
                for sign in (-1, 1):
                    table.append(
                        face(
                            PLANE, Opaque(), middle + sign * length / 2 * side, sign * side,
                            across=normal, half=(self.thickness / 2, other / 2),
                        )
                    )  # fmt: skip
        elif self.size is not None:
            rim = (self.thickness / 2, np.inf)
            table.append(face(CYLINDER, Opaque(), middle, normal, radius=radius, half=rim))
        return np.concatenate(table)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are in the glass; see `Solid`."""
        away = points - np.array(self.point)
        depth = -(away @ np.array(self.normal))
        return (depth > 0) & (depth < self.thickness) & _inside_outline(self, away)

    def samples(self) -> NDArray[np.float64]:
        """Return points on both faces; see `Solid`."""
        first = _on_plane(self)
        return np.concatenate([first, first - self.thickness * np.array(self.normal)])


@dataclass(frozen=True)
class Mirror(AnalyticSolid):
    """A plane mirror; its back is opaque.

    Parameters
    ----------
    name : str
    point : (3,)
        The middle of its face.
    normal : (3,)
        Out of the face that reflects.
    material : Reflecting
    size : float or (float, float), optional
        Diameter of a round mirror, or the sides of a rectangular one; endless by default.
    across : (3,), optional
        Direction of a rectangular mirror's first side, made perpendicular to the normal.
    """

    name: str
    point: Vector
    normal: Vector
    material: Reflecting = field(default_factory=Reflecting)
    size: float | tuple[float, float] | None = None
    across: Vector | None = None

    _POINTS, _DIRECTIONS, _LENGTHS = ("point",), ("normal", "across"), ("size",)

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        if not isinstance(self.material, Reflecting):
            raise ValueError(f"{self.what}: material: found {self.material!r}, expected mirror")
        _check_across(self)

    @property
    def diameter(self) -> float:
        """Its diameter; infinite for an endless one."""
        return math.inf if self.size is None else float(np.linalg.norm(self.size))

    def faces(self, medium: float) -> NDArray:
        """Return the table of its face; see `Solid`."""
        across, radius, half = _outline(self)
        return face(
            PLANE, self.material, self.point, self.normal, front=(medium, 0.0), across=across,
            radius=radius, half=half,
        )  # fmt: skip

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return False for all: it has no inside."""
        return np.zeros(len(points), bool)

    def samples(self) -> NDArray[np.float64]:
        """Return points on its face; see `Solid`."""
        return _on_plane(self)


def _check_across(plate: Window | Mirror) -> None:
    """Check the size of a plate, and make ``across`` perpendicular to its normal."""
    if plate.size is not None:
        size = np.asarray(plate.size, float)
        if size.shape not in ((), (2,)):
            raise ValueError(
                f"{plate.what}: size: found {plate.size!r}, expected a diameter or two sides"
            )
        if size.ndim:
            object.__setattr__(plate, "size", tuple(size.tolist()))
    if plate.across is None:
        return
    normal = np.array(plate.normal)
    across = np.array(plate.across) - (np.array(plate.across) @ normal) * normal
    length = np.linalg.norm(across)
    if not length > 1e-6:  # a direction along the normal leaves rounding alone
        raise ValueError(
            f"{plate.what}: across: found {list(plate.across)}, along the normal, expected a "
            "direction along the first side"
        )
    object.__setattr__(plate, "across", unit_vector(across))


class _Outline(NamedTuple):
    """The extent of a plate's face, as `rigs.scene.surfaces.face` takes it."""

    across: NDArray[np.float64]
    radius: float = np.inf
    half: tuple[float, float] = (np.inf, np.inf)


def _outline(plate: Window | Mirror) -> _Outline:
    """Return the extent of a plate's face."""
    normal = np.array(plate.normal)
    across = perpendicular(normal) if plate.across is None else np.array(plate.across)
    if plate.size is None:
        return _Outline(across)
    if isinstance(plate.size, tuple):
        return _Outline(across, half=(plate.size[0] / 2, plate.size[1] / 2))
    return _Outline(across, radius=plate.size / 2)


def _inside_outline(plate: Window | Mirror, away: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether points ``(N, 3)`` from a plate's middle are before or behind its face."""
    normal, (across, radius, half) = np.array(plate.normal), _outline(plate)
    flat = np.stack([away @ across, away @ np.cross(normal, across)], axis=1)
    inside = np.linalg.norm(flat, axis=1) <= radius
    return inside & (np.abs(flat) <= half).all(axis=1)


def _on_plane(plate: Window | Mirror) -> NDArray[np.float64]:
    """Return points on a plate's face, ``(N, 3)``; of an endless one its middle."""
    point = np.array(plate.point)
    if plate.size is None:
        return point[None]
    normal, (across, radius, half) = np.array(plate.normal), _outline(plate)
    half = half if isinstance(plate.size, tuple) else (radius, radius)
    steps = np.linspace(-1, 1, AROUND)
    u, v = np.meshgrid(steps * half[0], steps * half[1])
    points = u.ravel()[:, None] * across + v.ravel()[:, None] * np.cross(normal, across)
    return point + points[_inside_outline(plate, points)]
