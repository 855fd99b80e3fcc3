"""What stands in the light's way between the flame and the cameras."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.image_checks import rows_of
from rigs.scene.gas import Gas
from rigs.scene.mesh import Mesh
from rigs.scene.paths import EVERYWHERE, Paths, trace_paths
from rigs.scene.solids import Solid
from rigs.scene.surfaces import FACE, Reflecting, index_of
from rigs.scene.tracing import OPEN


@dataclass(frozen=True)
class Scene:
    """Windows, hardware and mirrors around a flame.

    Parameters
    ----------
    solids : sequence of Solid
        `Window`, `Cylinder`, `Sphere`, `Mirror` and `Mesh`; no two have one name.
    medium : float or str
        Refractive index of what surrounds them, or its name in `rigs.scene.surfaces.INDICES`.
    fresnel : bool
        Whether glass takes the fraction of light that it reflects.
    gas : Gas, optional
        Gas that bends or absorbs light.

    Raises
    ------
    ValueError
        If two solids have one name or overlap, an index is out of range, or the gas does not fit.

    Examples
    --------
    >>> quartz = Window("quartz", (0, 0, 50), (0, 0, 1), 10, Glass("quartz"))
    >>> paths = Scene((quartz,), medium="vacuum").paths([[0, 0, 100]], [[0.5, 0, -1]])
    >>> paths.lengths.round(3).tolist()
    [55.902, 10.524, inf]
    """

    solids: tuple[Solid, ...] = ()
    medium: float = 1.0
    fresnel: bool = False
    gas: Gas | None = None

    if TYPE_CHECKING:  # an index may be given by name; the field is a number

        def __init__(
            self,
            solids: Iterable[Solid] = ...,
            medium: float | str = 1.0,
            fresnel: bool = False,
            gas: Gas | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Check names and overlaps."""
        object.__setattr__(self, "solids", tuple(self.solids))
        object.__setattr__(self, "medium", index_of(self.medium, "scene: medium"))
        names = set()
        for solid in self.solids:
            if solid.name in names:
                raise ValueError(f"scene: solid {solid.name}: found twice, expected once")
            names.add(solid.name)
        for solid in self.solids:
            points = solid.samples()
            for other in self.solids:
                if other is not solid and other.contains(points).any():
                    raise ValueError(
                        f"scene: solids {solid.name} and {other.name}: found one in the other, "
                        "expected solids apart: light could not tell which medium it is in"
                    )

        if self.gas is not None:
            self.gas.check(self.solids, self.medium)

    def __bool__(self) -> bool:
        """Whether anything is in the way."""
        return bool(self.solids) or bool(self.gas)

    def check_outside(self, position: NDArray[np.float64], camera: str) -> None:
        """Raise if a camera stands in a solid."""
        for solid in self.solids:
            if solid.contains(position[None])[0]:
                raise ValueError(
                    f"{camera}: stands inside solid {solid.name}, expected outside: check the "
                    "scene's poses, its world (--world) and its unit"
                )

    @property
    def has_mirrors(self) -> bool:
        """Whether a solid reflects, so that a point may have several images."""
        return any(isinstance(solid.material, Reflecting) for solid in self.solids)

    @cached_property
    def _tables(self) -> tuple[NDArray, list[tuple[int, Mesh]]]:
        """All faces, and the meshes with the number of the row that stands for each."""
        parts, first = [np.zeros(0, FACE)], 0
        meshes: list[tuple[int, Mesh]] = []
        for number, solid in enumerate(self.solids):
            rows = solid.faces(self.medium)
            rows["solid"] = number
            if isinstance(solid, Mesh):
                meshes.append((first, solid))
            parts.append(rows)
            first += len(rows)
        return np.concatenate(parts), meshes

    def paths(
        self, origins: ArrayLike, directions: ArrayLike, region: NDArray[np.float64] = EVERYWHERE
    ) -> Paths:
        """Return the paths of rays ``(N, 3)``, from the camera on, outside all solids.

        Pieces that miss the box ``region`` ``(2, 3)`` are left out. A ray ends at an opaque face,
        at total reflection, or after `rigs.scene.paths.MOST_FACES` faces, else never.
        """
        origins = rows_of(origins, 3, "origins of rays")
        directions = rows_of(directions, 3, "directions of rays")
        norms = np.linalg.norm(directions, axis=1, keepdims=True)
        if not (np.isfinite(directions).all() and (norms > 0).all()):
            raise ValueError("directions of rays: found NaN or a zero vector, expected directions")
        bending = None if self.gas is None else self.gas.index
        if not self.solids and bending is None:
            n = len(origins)
            open_ahead = (np.full(n, np.inf), np.ones(n), np.full(n, -1))
            ends = np.full(n, OPEN)
            return Paths(origins, directions / norms, *open_ahead, np.arange(n + 1), ends)
        faces, meshes = self._tables
        return trace_paths(
            faces, meshes, self.medium, origins, directions / norms,
            fresnel=self.fresnel, region=region, gas=bending,
        )  # fmt: skip

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the scene after the rigid motion ``x_new = R @ x_old + t`` of the world."""
        solids = tuple(solid.transformed(R, t) for solid in self.solids)
        return replace(self, solids=solids, gas=self.gas and self.gas.transformed(R, t))

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the scene of a world whose lengths are ``factor`` times as large."""
        solids = tuple(solid.with_lengths_scaled(factor) for solid in self.solids)
        gas = self.gas and self.gas.with_lengths_scaled(factor)
        return replace(self, solids=solids, gas=gas)
