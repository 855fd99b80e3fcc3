"""Checks of the arrays that a box of voxels is made of."""

from __future__ import annotations

from dataclasses import Field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.rotation import numbers


def values_of(values: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return the finite values of a box of voxels, ``(nx, ny, nz)`` and read-only."""
    try:
        array = np.array(values, np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what}: found {type(values).__name__}, expected numbers") from None
    if array.ndim != 3 or 0 in array.shape:
        raise ValueError(f"{what}: found shape {array.shape}, expected (nx, ny, nz)")
    if not np.isfinite(array).all():
        raise ValueError(f"{what}: found NaN or infinity, expected finite numbers")
    array.setflags(write=False)
    return array


def corner(lower: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a box's lower corner, ``(3,)`` and read-only."""
    return numbers(lower, (3,), f"{what}: lower")


def edges(spacing: ArrayLike, what: str) -> NDArray[np.float64]:
    """Return a voxel's edges, ``(3,)`` and read-only; one number serves all."""
    found = numbers(np.broadcast_to(spacing, (3,)), (3,), f"{what}: spacing")
    if not (found > 0).all():
        raise ValueError(f"{what}: spacing: found {found.tolist()}, expected numbers above 0")
    return found


class VoxelBox:
    """What boxes of voxels share: dataclasses with ``values``, ``lower`` and ``spacing``."""

    if TYPE_CHECKING:  # of every one of them
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    spacing: NDArray[np.float64]

    @property
    def upper(self) -> NDArray[np.float64]:
        """The box's upper corner, ``(3,)``."""
        return self.lower + self.spacing * self.values.shape

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)
        )

    def __hash__(self) -> int:
        return hash((self.values.shape, float(self.values.sum())))

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the volume after a rigid motion that leaves its faces along the axes."""
        values, lower, spacing = moved_box(self.values, self.lower, self.spacing, R, t)
        return replace(self, values=values, lower=lower, spacing=spacing)


def moved_box(
    values: NDArray[np.float64],
    lower: NDArray[np.float64],
    spacing: NDArray[np.float64],
    R: NDArray[np.float64],
    t: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return values, lower corner and spacing of a box after the motion ``x_new = R @ x_old + t``.

    Raises
    ------
    ValueError
        If its faces leave the directions of the axes.
    """
    turn = np.rint(R)
    if np.abs(turn - R).max() > 1e-9:
        raise ValueError(
            "gas: found a rotation that turns its voxels off the axes, expected quarter turns: "
            "write the gas anew in the new world"
        )
    axes = np.abs(turn).argmax(axis=1)  # the old axis of each new one
    signs = turn[np.arange(3), axes]
    upper = lower + spacing * values.shape
    moved = np.transpose(values, axes)
    moved = moved[tuple(slice(None, None, int(sign)) for sign in signs)]
    ends = np.stack([turn @ lower, turn @ upper]) + t
    return np.ascontiguousarray(moved), ends.min(axis=0), spacing[axes]
