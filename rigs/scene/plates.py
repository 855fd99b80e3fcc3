"""Plates: windows and plane mirrors, round, rectangular or endless."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
    beyond: float | str | None = None
    size: float | tuple[float, float] | None = None
    across: Vector | None = None

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
        outline = _outline(self)
        glass = (self.material.index, self.material.extinction)
        beyond = (medium if self.beyond is None else self.beyond, 0.0)
        table = [
            face(PLANE, self.material, point, normal, front=(medium, 0.0), **outline),
            face(PLANE, self.material, second, normal, front=glass, behind=beyond, **outline),
        ]
        middle = (point + second) / 2
        if self.size is not None and np.ndim(self.size) == 0:
            half = (self.thickness / 2, np.inf)
            table.append(face(CYLINDER, Opaque(), middle, normal, radius=self.size / 2, half=half))
        elif self.size is not None:
            sides = (outline["across"], np.cross(normal, outline["across"]))
            for side, length, other in zip(sides, self.size, self.size[::-1], strict=True):
                for sign in (-1, 1):
                    table.append(
                        face(
                            PLANE, Opaque(), middle + sign * length / 2 * side, sign * side,
                            across=normal, half=(self.thickness / 2, other / 2),
                        )
                    )  # fmt: skip
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
        return face(
            PLANE, self.material, self.point, self.normal, front=(medium, 0.0), **_outline(self)
        )

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return False for all: it has no inside."""
        return np.zeros(len(points), bool)

    def samples(self) -> NDArray[np.float64]:
        """Return points on its face; see `Solid`."""
        return _on_plane(self)


def _check_across(plate: Window | Mirror) -> None:
    """Check the size of a plate, and make ``across`` perpendicular to its normal."""
    if plate.size is not None and np.shape(plate.size) not in ((), (2,)):
        raise ValueError(
            f"{plate.what}: size: found {plate.size!r}, expected a diameter or two sides"
        )
    if plate.size is not None and np.ndim(plate.size):
        object.__setattr__(plate, "size", tuple(float(side) for side in plate.size))
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


def _outline(plate: Window | Mirror) -> dict:
    """Return the extent of a plate's face, as `rigs.scene.surfaces.face` takes it."""
    normal = np.array(plate.normal)
    across = perpendicular(normal) if plate.across is None else np.array(plate.across)
    if plate.size is None:
        return {"across": across}
    if np.ndim(plate.size) == 0:
        return {"across": across, "radius": plate.size / 2}
    return {"across": across, "half": (plate.size[0] / 2, plate.size[1] / 2)}


def _inside_outline(plate: Window | Mirror, away: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether points ``(N, 3)`` from a plate's middle are before or behind its face."""
    outline = _outline(plate)
    normal, across = np.array(plate.normal), outline["across"]
    flat = np.stack([away @ across, away @ np.cross(normal, across)], axis=1)
    half = outline.get("half", (np.inf, np.inf))
    inside = np.linalg.norm(flat, axis=1) <= outline.get("radius", np.inf)
    return inside & (np.abs(flat) <= half).all(axis=1)


def _on_plane(plate: Window | Mirror) -> NDArray[np.float64]:
    """Return points on a plate's face, ``(N, 3)``; of an endless one its middle."""
    point = np.array(plate.point)
    if plate.size is None:
        return point[None]
    outline = _outline(plate)
    normal, across = np.array(plate.normal), outline["across"]
    half = np.array(outline.get("half", (outline.get("radius"),) * 2))
    steps = np.linspace(-1, 1, AROUND)
    u, v = np.meshgrid(steps * half[0], steps * half[1])
    points = u.ravel()[:, None] * across + v.ravel()[:, None] * np.cross(normal, across)
    return point + points[_inside_outline(plate, points)]
