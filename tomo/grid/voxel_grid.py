"""Where the voxels are: a box of equal, axis-aligned, half-open voxels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

    from rigs import Rig


SHORTEST, LONGEST = 1e-100, 1e100
"""Edge lengths between which no square or quotient of lengths leaves what float64 can hold."""

FINEST = 1e-4
"""Fraction of a voxel that coordinates in the world have to tell apart."""


def _floats(found: ArrayLike) -> NDArray[np.float64]:
    """Return an array of what are numbers, else NaN."""
    try:
        return np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError):
        return np.asarray(np.nan)


@dataclass(frozen=True)
class VoxelGrid:
    """A box of ``shape`` voxels; arrays on it are ``volume[ix, iy, iz]`` in C order.

    Voxels are half-open boxes: a point on a face belongs to the voxel above it, and the upper
    outer face of the grid belongs to the last voxel.

    Parameters
    ----------
    shape : (int, int, int)
        Number of voxels along x, y, z.
    spacing : float or (float, float, float)
        Edge lengths of a voxel, in the rig's length unit.
    center : (float, float, float)
        The middle of the box in world coordinates.

    Raises
    ------
    ValueError
        If a count is below one, a length is not positive or no float64 can square it, or the
        box is so far from the origin that float64 does not tell its voxels apart.

    Examples
    --------
    >>> VoxelGrid((2, 4, 2), 0.5).origin
    array([-0.25, -0.75, -0.25])
    """

    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    if TYPE_CHECKING:  # as called: sequences of any kind, and one length for all axes

        def __init__(
            self,
            shape: Sequence[int],
            spacing: float | Sequence[float],
            center: Sequence[float] = (0.0, 0.0, 0.0),
        ) -> None: ...

    def __post_init__(self) -> None:
        """Normalise to plain tuples, so that grids compare, hash and print as values."""
        try:
            shape = tuple(int(n) for n in self.shape)
        except (TypeError, ValueError, OverflowError):
            shape = ()
        if len(shape) != 3 or min(shape) < 1 or shape != tuple(self.shape):
            raise ValueError(f"grid shape: found {self.shape}, expected three whole numbers >= 1")
        lengths = _floats(self.spacing)
        if lengths.shape not in ((), (3,)):
            raise ValueError(f"grid spacing: found {self.spacing}, expected one or three lengths")
        spacing = tuple(np.broadcast_to(lengths, 3).tolist())
        if not all(math.isfinite(s) and s > 0 for s in spacing):
            raise ValueError(f"grid spacing: found {self.spacing}, expected positive lengths")
        center = _floats(self.center)
        if center.shape != (3,) or not np.isfinite(center).all():
            raise ValueError(f"grid center: found {self.center}, expected three finite numbers")
        if not all(SHORTEST <= s <= LONGEST for s in spacing):
            raise ValueError(
                f"grid spacing: found {self.spacing}, expected lengths from {SHORTEST} to "
                f"{LONGEST}"
            )
        step = np.spacing(np.abs(center) + np.multiply(shape, spacing) / 2)
        if (step > np.multiply(FINEST, spacing)).any():
            raise ValueError(
                f"grid center: found {center.tolist()} and voxels of {list(spacing)}, expected "
                f"fewer voxels from the origin: coordinates there are {step.max():.2g} apart"
            )
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "spacing", spacing)
        object.__setattr__(self, "center", tuple(center.tolist()))

    @classmethod
    def from_bounds(cls, shape: Sequence[int], lower: ArrayLike, upper: ArrayLike) -> VoxelGrid:
        """Return the grid of ``shape`` voxels that fills the box from ``lower`` to ``upper``."""
        lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
        if lower.shape != (3,) or upper.shape != (3,) or not (upper > lower).all():
            raise ValueError(
                f"grid bounds: found lower {lower.tolist()} and upper {upper.tolist()}, "
                "expected three coordinates each with upper above lower"
            )
        shape = cls(tuple(shape), 1.0).shape  # checked before anything is divided by it
        return cls(shape, tuple((upper - lower) / shape), tuple((lower + upper) / 2))

    @classmethod
    def from_origin(cls, shape: Sequence[int], spacing: ArrayLike, origin: ArrayLike) -> VoxelGrid:
        """Return the grid whose voxel (0, 0, 0) is centred at ``origin`` (VTK, ITK, NRRD)."""
        spacing = np.broadcast_to(np.asarray(spacing, np.float64), 3)
        shape = cls(tuple(shape), tuple(spacing.tolist())).shape
        center = np.asarray(origin, np.float64) + (np.asarray(shape) - 1) / 2 * spacing
        return cls(shape, tuple(spacing.tolist()), tuple(center.tolist()))

    @classmethod
    def from_xarray(cls, array: DataArray | Dataset) -> VoxelGrid:
        """Return the grid whose voxels are centred at the coordinates x, y and z.

        The grid of `tomo.Reconstruction.to_xarray`, and of a film's store, comes back exactly;
        that of a part of such an array is the part's.

        Raises
        ------
        ValueError
            If coordinates are missing or not evenly spaced, or one stands alone and the
            attributes have no ``spacing``.
        """
        from tomo.grid.coordinates import voxels_of

        shape, spacing, center = voxels_of(array)
        return cls(shape, tuple(spacing), tuple(center))

    def to_mapping(self) -> dict[str, list]:
        """Return ``shape``, ``spacing`` and ``center`` as plain lists, for files."""
        return {name: list(getattr(self, name)) for name in ("shape", "spacing", "center")}

    def _repr_html_(self) -> str:
        """Return what a notebook shows: a table."""
        from rigs.notebook import facts, framed, times

        ends = zip("xyz", self.lower, self.upper, strict=True)
        rows = [
            ("voxels", f"{times(self.shape)} = {self.size:,}"),
            ("edges of a voxel", times(self.spacing)),
            ("box", times(self.extent)),
            ("from, to", "; ".join(f"{axis} {low:.6g} to {high:.6g}" for axis, low, high in ends)),
            ("center", ", ".join(f"{value:.6g}" for value in self.center)),
            ("a volume takes", f"{4e-6 * self.size:.3g} MB"),
        ]
        return framed("Voxel grid", facts(rows))

    @property
    def size(self) -> int:
        """Number of voxels."""
        return math.prod(self.shape)

    @property
    def extent(self) -> NDArray[np.float64]:
        """Edge lengths of the whole box, ``(3,)``."""
        return np.multiply(self.shape, self.spacing)

    @property
    def lower(self) -> NDArray[np.float64]:
        """The box's lower outer corner, ``(3,)``."""
        return np.asarray(self.center) - self.extent / 2

    @property
    def upper(self) -> NDArray[np.float64]:
        """The box's upper outer corner, ``(3,)``."""
        return np.asarray(self.center) + self.extent / 2

    @property
    def origin(self) -> NDArray[np.float64]:
        """Centre of voxel (0, 0, 0), ``(3,)``."""
        return self.lower + np.asarray(self.spacing) / 2

    def to_voxel_units(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return ``points`` ``(..., 3)`` in voxels from the lower corner; faces are integers.

        What lies on or below `upper` is never above ``shape``, however the division rounds: else
        the upper outer face of most grids would not be theirs.
        """
        points = np.asarray(points, np.float64)
        position = (points - self.lower) / self.spacing
        return np.where(points <= self.upper, np.minimum(position, self.shape), position)

    def voxel_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Return the flat voxel index of each of ``points`` ``(..., 3)``; -1 is outside.

        Raises
        ------
        ValueError
            If the grid has more voxels than can be numbered.
        """
        if self.size > np.iinfo(np.int64).max:
            raise ValueError(f"grid shape: found {self.shape}, more voxels than int64 can number")
        position = self.to_voxel_units(points)
        shape = np.asarray(self.shape)
        inside = np.asarray(((position >= 0) & (position <= shape)).all(axis=-1))
        index = np.floor(np.where(inside[..., None], position, 0.0)).astype(np.int64)
        index = np.minimum(index, shape - 1)  # the upper outer face belongs to the last voxel
        _, ny, nz = self.shape
        flat = (index[..., 0] * ny + index[..., 1]) * nz + index[..., 2]
        return np.where(inside, flat, -1)

    def axes(self) -> tuple[NDArray[np.float64], ...]:
        """Return the voxel centres along x, y and z: vectors ``(nx,)``, ``(ny,)``, ``(nz,)``."""
        return tuple(
            o + s * np.arange(n)
            for o, s, n in zip(self.origin, self.spacing, self.shape, strict=True)
        )

    def centers(self) -> NDArray[np.float64]:
        """Return the centre of every voxel, ``(nx, ny, nz, 3)``."""
        return np.stack(np.meshgrid(*self.axes(), indexing="ij"), axis=-1)

    def coincides(self, other: VoxelGrid) -> bool:
        """Return whether both have the same voxels, up to the rounding of files."""
        from tomo.grid.coordinates import UNEVEN

        if self.shape != other.shape:
            return False
        off = np.abs([self.lower - other.lower, self.upper - other.upper])
        return self == other or bool((off <= UNEVEN * np.asarray(self.spacing)).all())

    def refined(self, factor: int) -> VoxelGrid:
        """Return the grid of the same box with voxels ``factor`` times finer along each axis."""
        if factor < 1 or factor != int(factor):
            raise ValueError(f"grid refinement: found {factor}, expected a whole number >= 1")
        shape = tuple(n * int(factor) for n in self.shape)
        return VoxelGrid(shape, tuple(s / factor for s in self.spacing), self.center)

    def average(self, fine: NDArray, factor: int) -> NDArray:
        """Return the means over this grid's voxels of a volume on ``self.refined(factor)``."""
        expected = tuple(n * factor for n in self.shape)
        if fine.shape != expected:
            raise ValueError(f"volume to average: found shape {fine.shape}, expected {expected}")
        nx, ny, nz = self.shape
        blocks = fine.reshape(nx, factor, ny, factor, nz, factor)
        return blocks.mean(axis=(1, 3, 5), dtype=np.float64).astype(fine.dtype)


def grid_of_rig(rig: Rig) -> VoxelGrid | None:
    """Return the voxels that a rig was made for; None where it names none."""
    volume = rig.volume
    return None if volume is None else VoxelGrid(volume.shape, volume.spacing, volume.center)
