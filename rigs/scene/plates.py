"""Plates: windows and plane mirrors, round, rectangular or endless."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rigs.scene.solids import AROUND, AnalyticSolid, Vector, unit_vector
from rigs.scene.surfaces import (
    CYLINDER,
    PLANE,
    Glass,
    Opaque,
    Reflecting,
    face,
    index_of,
    perpendicular,
)


class _Plate(AnalyticSolid):
    """What windows and mirrors share: a plane face, round, rectangular or endless."""

    if TYPE_CHECKING:  # both are dataclasses that have these fields
        point: Vector
        normal: Vector
        size: float | tuple[float, float] | None
        across: Vector | None

    _POINTS, _DIRECTIONS = ("point",), ("normal", "across")
    _MADE_OF: ClassVar[tuple[type, str]]

    def __post_init__(self) -> None:
        """Check every field, and make ``across`` perpendicular to the normal."""
        super().__post_init__()
        kind, words = self._MADE_OF
        if not isinstance(self.material, kind):
            raise ValueError(f"{self.what}: material: found {self.material!r}, expected {words}")
        if self.size is not None:
            size = np.asarray(self.size, float)
            if size.shape not in ((), (2,)):
                raise ValueError(f"{self.what}: size: found {self.size!r}, expected one or two")
            if size.ndim:
                object.__setattr__(self, "size", tuple(size.tolist()))
        if self.across is None:
            return
        normal = np.array(self.normal)
        across = np.array(self.across) - (np.array(self.across) @ normal) * normal
        length = np.linalg.norm(across)
        if not length > 1e-6:  # a direction along the normal leaves rounding alone
            raise ValueError(
                f"{self.what}: across: found {list(self.across)}, along the normal, expected a "
                "direction along the first side"
            )
        object.__setattr__(self, "across", unit_vector(across))

    @property
    def _outline(self) -> dict[str, Any]:
        """The extent of the face, as `rigs.scene.surfaces.face` takes it."""
        normal = np.array(self.normal)
        across = perpendicular(normal) if self.across is None else np.array(self.across)
        if self.size is None:
            return {"across": across, "radius": np.inf, "half": (np.inf, np.inf)}
        if isinstance(self.size, tuple):
            half = (self.size[0] / 2, self.size[1] / 2)
            return {"across": across, "radius": np.inf, "half": half}
        return {"across": across, "radius": self.size / 2, "half": (np.inf, np.inf)}

    def _inside_outline(self, away: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points ``(N, 3)`` from the middle are before or behind the face."""
        normal, own = np.array(self.normal), self._outline
        across = own["across"]
        flat = np.stack([away @ across, away @ np.cross(normal, across)], axis=1)
        inside = np.linalg.norm(flat, axis=1) <= own["radius"]
        return inside & (np.abs(flat) <= own["half"]).all(axis=1)

    def samples(self) -> NDArray[np.float64]:
        """Return points on the face, ``(N, 3)``; of an endless one its middle; see `Solid`."""
        point = np.array(self.point)
        if self.size is None:
            return point[None]
        normal, own = np.array(self.normal), self._outline
        half = own["half"] if isinstance(self.size, tuple) else (own["radius"], own["radius"])
        steps = np.linspace(-1, 1, AROUND)
        u, v = np.meshgrid(steps * half[0], steps * half[1])
        across = own["across"]
        points = u.ravel()[:, None] * across + v.ravel()[:, None] * np.cross(normal, across)
        return point + points[self._inside_outline(points)]


@dataclass(frozen=True)
class Window(_Plate):
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

    _LENGTHS, _MADE_OF = ("thickness", "size"), (Glass, "glass")

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        if not math.isfinite(self.thickness):
            raise ValueError(f"{self.what}: thickness: found {self.thickness}, expected a length")
        if self.beyond is not None:
            index = index_of(self.beyond, f"{self.what}: beyond")
            object.__setattr__(self, "beyond", index)

    @property
    def diameter(self) -> float:
        """Its diameter; the thickness of an endless one."""
        return self.thickness if self.size is None else float(np.linalg.norm(self.size))

    def faces(self, medium: float) -> NDArray:
        """Return the table of its faces; see `Solid`."""
        normal, point = np.array(self.normal), np.array(self.point)
        second = point - self.thickness * normal
        outline = self._outline
        glass = (self.material.index, self.material.extinction)
        beyond = (medium if self.beyond is None else self.beyond, 0.0)
        table = [
            face(PLANE, self.material, place, normal, front=front, behind=behind, **outline)
            for place, front, behind in ((point, (medium, 0.0), None), (second, glass, beyond))
        ]
        middle = (point + second) / 2
        if isinstance(self.size, tuple):
            sides = (outline["across"], np.cross(normal, outline["across"]))
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
            table.append(face(CYLINDER, Opaque(), middle, normal, radius=self.size / 2, half=rim))
        return np.concatenate(table)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points are in the glass; see `Solid`."""
        away = points - np.array(self.point)
        depth = -(away @ np.array(self.normal))
        return (depth > 0) & (depth < self.thickness) & self._inside_outline(away)

    def samples(self) -> NDArray[np.float64]:
        """Return points on both faces; see `Solid`."""
        first = super().samples()
        return np.concatenate([first, first - self.thickness * np.array(self.normal)])


@dataclass(frozen=True)
class Mirror(_Plate):
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

    _LENGTHS, _MADE_OF = ("size",), (Reflecting, "mirror")

    @property
    def diameter(self) -> float:
        """Its diameter; infinite for an endless one."""
        return math.inf if self.size is None else float(np.linalg.norm(self.size))

    def faces(self, medium: float) -> NDArray:
        """Return the table of its face; see `Solid`."""
        front = (medium, 0.0)
        return face(PLANE, self.material, self.point, self.normal, front=front, **self._outline)

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return False for all: it has no inside."""
        return np.zeros(len(points), bool)
