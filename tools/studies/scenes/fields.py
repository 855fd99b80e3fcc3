"""Known fields: emission in continuous space, by family and seed, sized for a grid."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from studies.scenes import report_fields, settle_fields
from studies.scenes.shapes import Shape, waves
from tomo import VoxelGrid

SETTLE = {
    "tilted cone": settle_fields.tilted_cone,
    "interacting jets": settle_fields.interacting_jets,
    "sparks": settle_fields.sparks,
    "smoke sheets": settle_fields.smoke_sheets,
    "core with halo": settle_fields.core_with_halo,
    "cut column": settle_fields.cut_column,
    "vortex rings": settle_fields.vortex_rings,
}
REPORT = {
    "hollow swirl": report_fields.hollow_swirl,
    "averaged jet": report_fields.averaged_jet,
    "separate blobs": report_fields.separate_blobs,
    "half-voxel sheets": report_fields.half_voxel_sheets,
    "branching fingers": report_fields.branching_fingers,
    "filled box": report_fields.filled_box,
    "cut flame": report_fields.cut_flame,
}
SPECIAL_SETTLE = {
    "off-axis cone": settle_fields.off_axis_cone,
    "fine wrinkles": settle_fields.fine_wrinkles,
}
SPECIAL_REPORT = {
    "off-axis plume": report_fields.off_axis_plume,
    "fine ripples": report_fields.fine_ripples,
}
"""Faultless too, and taken for faulty easily: seen by rigs of which half of the views cut the
flame, or finer than any view resolves."""

FAMILIES: Mapping[str, Callable[[np.random.Generator, NDArray], Shape]] = (
    SETTLE | REPORT | SPECIAL_SETTLE | SPECIAL_REPORT
)

CUT = ("cut column", "cut flame")
"""Families whose light goes on above the grid: a report that says so is right."""

ABOVE = 0.4  # fraction of the grid's height that such light may reach above it
POINTS_AT_ONCE = 1 << 15  # points that are evaluated together: more leave a core's cache


class Field(Protocol):
    """Emission in space, and the box outside of which there is none."""

    @property
    def grid(self) -> VoxelGrid:
        """The voxels to reconstruct."""

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The lower and the upper corner, ``(3,)`` each."""

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)`` at ``points`` ``(..., 3)`` in world coordinates."""


@dataclass(frozen=True)
class KnownField:
    """A member of a family of fields, sized for a grid of cubic voxels."""

    family: str  # one of `FAMILIES`
    seed: int  # selects the member; equal seeds give the same field
    grid: VoxelGrid

    def __post_init__(self) -> None:
        """Check the family."""
        if self.family not in FAMILIES:
            known = ", ".join(FAMILIES)
            raise ValueError(f"family: found {self.family!r}, expected one of {known}")

    @cached_property
    def shape(self) -> Shape:
        """The emission at points in voxels from the grid's middle."""
        random = np.random.default_rng([self.seed, zlib.crc32(self.family.encode())])
        return FAMILIES[self.family](random, np.array(self.grid.shape) / 2)

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The box outside of which there is no light: the grid's, and above it where cut."""
        above = ABOVE * self.grid.extent[1] if self.family in CUT else 0.0
        return self.grid.lower, self.grid.upper + np.array([0.0, above, 0.0])

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)``, not negative, at ``points`` ``(..., 3)``."""
        away = np.asarray(points, np.float64) - self.grid.center
        flat = (away / self.grid.spacing[0]).astype(np.float32).reshape(-1, 3)
        found = np.zeros(len(flat), np.float32)
        for start in range(0, len(flat), POINTS_AT_ONCE):
            part = slice(start, start + POINTS_AT_ONCE)
            found[part] = np.maximum(self.shape(flat[part]), 0)
        return found.reshape(away.shape[:-1])


@dataclass(frozen=True)
class LaterField(KnownField):
    """A field at another moment: its gas displaced by a smooth random motion."""

    distance: float  # root mean square of each component of the displacement, in voxels

    @cached_property
    def shape(self) -> Shape:
        """The emission at points in voxels from the grid's middle."""
        still = KnownField(self.family, self.seed, self.grid).shape
        random = np.random.default_rng([self.seed, 1])
        longest = float(max(self.grid.shape))
        motions = [waves(random, 3, longest / 2, 1.5 * longest) for _ in range(3)]

        def emission(points: NDArray[np.float32]) -> NDArray[np.float32]:
            moved = np.stack([motion(points) for motion in motions], axis=1)
            return still(points + np.float32(self.distance) * moved)

        return emission


@dataclass(frozen=True)
class WithLamp:
    """A field and a lamp outside of the grid, at the height of its middle."""

    field: KnownField
    strength: float  # peak emission of the lamp
    angle: float  # where it stands around the axis y, in radians

    @property
    def grid(self) -> VoxelGrid:
        """The grid of the field."""
        return self.field.grid

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The box outside of which there is no light: the field's and the lamp's."""
        room = 4 * self._width
        lower, upper = self.field.reach
        return np.minimum(lower, self._place - room), np.maximum(upper, self._place + room)

    @property
    def _width(self) -> float:
        return 1.5 * self.grid.spacing[0]

    @property
    def _place(self) -> NDArray[np.float64]:
        half = self.grid.extent / 2
        away = np.array([np.cos(self.angle), 0.0, np.sin(self.angle)])
        along = min(half[axis] / max(abs(away[axis]), 1e-9) for axis in (0, 2))
        return np.asarray(self.grid.center) + (along + 4 * self._width) * away

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)``, not negative, at ``points`` ``(..., 3)``."""
        points = np.asarray(points)
        square = np.square((points - self._place) / self._width).sum(axis=-1)
        inside = ((points >= self.field.reach[0]) & (points <= self.field.reach[1])).all(axis=-1)
        lamp = (self.strength * np.exp(-0.5 * square)).astype(np.float32)
        return np.where(inside, self.field(points), 0) + lamp
