"""The scene that bends lines of sight in an adjustment, and its windows that are adjusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs.geometry.rotation import matrix_of_vector
from rigs.scene.plates import Window
from rigs.scene.scene import Scene
from rigs.scene.sight_lines import WINDOW, endless, sight_lines
from rigs.scene.solids import Solid, vector_of
from rigs.scene.surfaces import BLOCKS, perpendicular


@dataclass(frozen=True)
class WindowPrior:
    """Standard deviations of a window's given pose and thickness; what has none is held.

    Parameters
    ----------
    name : str
        The window's, in the scene.
    normal : float
        Of its direction, each way, in degrees.
    distance : float
        Of its place along the normal, in the rig's length unit.
    thickness : float
        In the rig's length unit.

    Raises
    ------
    ValueError
        If a number is negative or all are zero.

    Examples
    --------
    >>> WindowPrior.parsed("quartz:normal=2,thickness=0.1")
    WindowPrior(name='quartz', normal=2.0, distance=0.0, thickness=0.1)
    """

    name: str
    normal: float = 0.0
    distance: float = 0.0
    thickness: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        values = (self.normal, self.distance, self.thickness)
        if not all(0 <= value < math.inf for value in values) or not any(values):
            raise ValueError(
                f"window {self.name}: found standard deviations {values}, expected those of what "
                "is adjusted: normal (degrees), distance, thickness"
            )

    @property
    def deviations(self) -> tuple[float, float, float, float]:
        """Those of its four numbers: two tilts in radians, distance, thickness."""
        tilt = math.radians(self.normal)
        return tilt, tilt, self.distance, self.thickness

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Return the prior of a text ``NAME:normal=2,distance=1,thickness=0.1``."""
        name, _, values = text.rpartition(":")
        known = [field.name for field in fields(cls)[1:]]
        found = {}
        for part in values.split(","):
            key, _, number = part.partition("=")
            try:
                found[key.strip()] = float(number)
            except ValueError:
                found[""] = 0.0
        if not name.strip() or not set(found) <= set(known):
            raise ValueError(
                f"found {text!r}, expected NAME:normal=DEGREES,distance=LENGTH,thickness=LENGTH, "
                "the standard deviations of what is adjusted of a window"
            )
        return cls(name.strip(), **found)


@dataclass(frozen=True, eq=False)
class Refraction:
    """A scene in front of the cameras of an adjustment, as it stands and as it was ``given``.

    A window that is adjusted (``priors``; lengths in the unit of both scenes) has four numbers:
    tilts of its normal about its ``point`` towards the two directions along it (radians), its
    place along the normal, and its thickness. ``noise``, the standard deviation of a pixel
    coordinate, says what a prior weighs in squared pixels.
    """

    scene: Scene
    given: Scene
    priors: tuple[WindowPrior, ...] = ()
    noise: float = 1.0

    @classmethod
    def of(cls, scene: Scene, priors: Sequence[WindowPrior] = ()) -> Self:
        """Return the scene as it was measured, with directions along every window."""
        windows = {solid.name for solid in scene.solids if isinstance(solid, Window)}
        names = [prior.name for prior in priors]
        for name in names:
            if name not in windows or names.count(name) > 1:
                raise ValueError(
                    f"window {name}: found {'twice' if name in windows else 'no such window'}, "
                    f"expected windows of the scene: {', '.join(sorted(windows)) or 'it has none'}"
                )
        solids = tuple(
            replace(solid, across=vector_of(perpendicular(np.array(solid.normal))))
            if isinstance(solid, Window) and solid.across is None
            else solid
            for solid in scene.solids
        )
        scene = replace(scene, solids=solids)
        return cls(scene, scene, tuple(priors))

    @property
    def size(self) -> int:
        """How many numbers the adjusted windows have."""
        return WINDOW * len(self.priors)

    @property
    def deviations(self) -> NDArray[np.float64]:
        """The priors' standard deviations ``(size,)``; 0 where a number is held."""
        return np.array([prior.deviations for prior in self.priors]).reshape(-1)

    @property
    def weights(self) -> NDArray[np.float64]:
        """What each squared change from the given scene costs ``(size,)``, in squared pixels."""
        held = self.deviations == 0
        return np.where(held, 0.0, (self.noise / np.where(held, 1.0, self.deviations)) ** 2)

    @property
    def changes(self) -> NDArray[np.float64]:
        """By how much the windows' numbers differ from those given, ``(size,)``."""
        found = []
        for prior in self.priors:
            now, before = self.window(prior.name), _window(self.given, prior.name)
            normal, across = np.array(before.normal), np.array(before.across)
            shift = np.subtract(now.point, before.point) @ normal
            tilts = (across @ now.normal, np.cross(normal, across) @ now.normal)
            found.append((*tilts, shift, now.thickness - before.thickness))
        return np.array(found, float).reshape(-1)

    def window(self, name: str) -> Window:
        """Return a window as it stands."""
        return _window(self.scene, name)

    def moved(self, step: NDArray[np.float64]) -> Self:
        """Return the scene after changes ``(size,)`` of its windows' numbers."""
        if not step.any():
            return self
        solids: dict[str, Solid] = {solid.name: solid for solid in self.scene.solids}
        for prior, own in zip(self.priors, step.reshape(-1, WINDOW), strict=True):
            window = self.window(prior.name)
            normal, across = np.array(window.normal), np.array(window.across)
            along = own[0] * across + own[1] * np.cross(normal, across)
            R = matrix_of_vector(np.cross(normal, along))
            thickness = max(window.thickness + own[3], window.thickness / 10)
            solids[prior.name] = replace(
                window,
                point=vector_of(np.array(window.point) + own[2] * normal),
                normal=vector_of(R @ normal),
                across=vector_of(R @ across),
                thickness=float(thickness),
            )
        return replace(self, scene=replace(self.scene, solids=tuple(solids.values())))

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the windows after ``x_new = R x_old + t`` of the cameras.

        A window that is given has its place in the world; only those that are adjusted follow.
        """
        adjusted = {prior.name for prior in self.priors}
        solids = tuple(
            solid.transformed(R, t) if solid.name in adjusted else solid
            for solid in self.scene.solids
        )
        return replace(self, scene=replace(self.scene, solids=solids))

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the scene of a world whose lengths are ``factor`` times as large."""
        priors = tuple(
            replace(prior, distance=prior.distance * factor, thickness=prior.thickness * factor)
            for prior in self.priors
        )
        return replace(
            self,
            scene=self.scene.with_lengths_scaled(factor),
            given=self.given.with_lengths_scaled(factor),
            priors=priors,
        )

    @cached_property
    def _tables(self) -> tuple[NDArray, NDArray, NDArray]:
        """Endless faces, the number of each one's adjusted window, and its depth in it."""
        names = [prior.name for prior in self.priors]
        rows, windows, depths = [], [], []
        for number, solid in enumerate(self.scene.solids):
            own = solid.faces(self.scene.medium)
            own["solid"] = number
            adjusted = isinstance(solid, Window) and solid.name in names
            depth = np.array([0.0, solid.thickness if isinstance(solid, Window) else 0.0])
            rows.append(own)
            windows.append(np.full(len(own), names.index(solid.name) if adjusted else -1))
            depths.append(np.pad(depth, (0, max(len(own) - 2, 0)))[: len(own)])
        return endless(np.concatenate(rows)), np.concatenate(windows), np.concatenate(depths)

    @property
    def faces(self) -> NDArray:
        """All faces, without borders, ``(F,)`` of `rigs.scene.surfaces.FACE`."""
        return self._tables[0]

    def passing(self, number: int) -> NDArray[np.int64]:
        """Return the faces of a solid that do not block light."""
        return np.flatnonzero((self.faces["solid"] == number) & (self.faces["action"] != BLOCKS))

    def directions(
        self, center: NDArray[np.float64], points: NDArray[np.float64], routes: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the unit directions ``(N, 3)`` in which points are seen from ``center``.

        NaN where no path along the point's route (`routes_to`) passes it.
        """
        found, none = np.zeros((len(points), 3)), np.zeros((0, 3, 3))
        sight_lines(
            center, points, self.faces, routes, *self._tables[1:], found, none, none,
            np.zeros((0, 3, 0)),
        )  # fmt: skip
        return found

    def derivatives(
        self, center: NDArray[np.float64], points: NDArray[np.float64], routes: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return `directions`, and derivatives by center, points ``(N, 3, 3)`` and windows."""
        count = len(points)
        found = np.zeros((count, 3))
        by_center, by_point = np.zeros((2, count, 3, 3))
        by_window = np.zeros((count, 3, self.size))
        sight_lines(
            center, points, self.faces, routes, *self._tables[1:], found, by_center, by_point,
            by_window,
        )  # fmt: skip
        return found, by_center, by_point, by_window


def _window(scene: Scene, name: str) -> Window:
    """Return the window of a scene by name."""
    windows = (solid for solid in scene.solids if isinstance(solid, Window))
    return next(window for window in windows if window.name == name)
