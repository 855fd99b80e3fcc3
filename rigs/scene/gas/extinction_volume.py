"""Boxes of voxels, and how strongly gas in one absorbs."""

from __future__ import annotations

from dataclasses import Field, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.geometry.rotation import numbers


class VoxelBox:
    """What boxes of voxels share: dataclasses with ``values``, ``lower`` and ``spacing``."""

    if TYPE_CHECKING:  # of every one of them
        __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    spacing: NDArray[np.float64]

    def _keep(self, what: str, least: float, expected: str) -> None:
        """Check the arrays, and keep them read-only; one edge serves all axes."""
        try:
            values = np.array(self.values, np.float64, order="C")
        except (TypeError, ValueError, OverflowError):
            found = type(self.values).__name__
            raise ValueError(f"{what}: found {found}, expected numbers") from None
        if values.ndim != 3 or 0 in values.shape:
            raise ValueError(f"{what}: found shape {values.shape}, expected (nx, ny, nz)")
        if not np.isfinite(values).all():
            raise ValueError(f"{what}: found NaN or infinity, expected finite numbers")
        if values.min() < least:
            place = tuple(np.argwhere(values == values.min())[0].tolist())
            raise ValueError(
                f"{what}: found {values.min():.6g} in voxel {place}, expected {expected}"
            )
        values.setflags(write=False)
        spacing = numbers(np.broadcast_to(self.spacing, (3,)), (3,), f"{what}: spacing")
        if not (spacing > 0).all():
            raise ValueError(f"{what}: spacing: found {spacing.tolist()}, expected positive ones")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "lower", numbers(self.lower, (3,), f"{what}: lower"))
        object.__setattr__(self, "spacing", spacing)

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
        """Return the volume after ``x_new = R @ x_old + t``; its faces must stay along axes."""
        turn = np.rint(R)
        if np.abs(turn - R).max() > 1e-9:
            raise ValueError(
                "gas: found a rotation that turns its voxels off the axes, expected quarter "
                "turns: write the gas anew in the new world"
            )
        axes = np.abs(turn).argmax(axis=1)  # the old axis of each new one
        signs = turn[np.arange(3), axes]
        moved = np.transpose(self.values, axes)
        moved = moved[tuple(slice(None, None, int(sign)) for sign in signs)]
        ends = np.stack([turn @ self.lower, turn @ self.upper]) + t
        return replace(self, values=moved, lower=ends.min(axis=0), spacing=self.spacing[axes])


@dataclass(frozen=True, eq=False)
class ExtinctionVolume(VoxelBox):
    """An extinction coefficient, constant in each voxel of a box and zero outside.

    Parameters
    ----------
    values : (nx, ny, nz) array_like
        In 1 / length: ``exp(-k s)`` of the light is left after the way ``s``.
    lower : (3,) array_like
        The box's lower corner.
    spacing : float or (3,)
        Edges of a voxel.

    Raises
    ------
    ValueError
        If the shapes are wrong, or a number is not finite or negative.
    """

    values: NDArray[np.float64]
    lower: NDArray[np.float64]
    spacing: NDArray[np.float64]

    if TYPE_CHECKING:  # arrays may be given in any form; the fields are arrays

        def __init__(self, values: ArrayLike, lower: ArrayLike, spacing: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        """Check the values, and keep them read-only."""
        self._keep("extinction volume", 0, "numbers >= 0, in 1 / length")

    def __repr__(self) -> str:
        """Name the box."""
        return (
            f"<ExtinctionVolume: {'x'.join(str(n) for n in self.values.shape)} voxels, up to "
            f"{self.values.max():.4g}>"
        )

    def means(
        self, lower: ArrayLike, spacing: ArrayLike, shape: tuple[int, int, int]
    ) -> NDArray[np.float64]:
        """Return the mean extinction in each voxel of another box that begins at ``lower``.

        Exact: voxels count by the volume that they share, which is a product over the axes.
        """
        means = self.values
        first, wide = np.asarray(lower, np.float64), np.asarray(spacing, np.float64)
        for axis, (start, edge, count) in enumerate(zip(first, wide, shape, strict=True)):
            theirs = start + edge * np.arange(count + 1)
            own = self.lower[axis] + self.spacing[axis] * np.arange(means.shape[axis] + 1)
            if count == means.shape[axis] and np.allclose(own, theirs, 0, 1e-9 * edge):
                continue  # the same voxels: without rounding
            shared = np.minimum(theirs[1:, None], own[1:]) - np.maximum(
                theirs[:-1, None], own[:-1]
            )
            fractions = np.maximum(shared, 0) / edge  # (count, own)
            means = np.moveaxis(np.tensordot(fractions, means, (1, axis)), 0, axis)
        return np.ascontiguousarray(means)

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the volume of a world whose lengths are ``factor`` times as large."""
        return replace(
            self, values=self.values / factor, lower=self.lower * factor,
            spacing=self.spacing * factor,
        )  # fmt: skip
