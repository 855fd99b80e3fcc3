"""How strongly gas absorbs, given in a box of voxels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.scene.gas.voxels import VoxelBox, corner, edges, values_of


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
        values = values_of(self.values, "extinction volume")
        if values.min() < 0:
            place = tuple(np.argwhere(values == values.min())[0].tolist())
            raise ValueError(
                f"extinction volume: found {values.min():.6g} in voxel {place}, expected numbers "
                ">= 0, in 1 / length"
            )
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "lower", corner(self.lower, "extinction volume"))
        object.__setattr__(self, "spacing", edges(self.spacing, "extinction volume"))

    def __repr__(self) -> str:
        """Name the box."""
        return (
            f"<ExtinctionVolume: {'x'.join(str(n) for n in self.values.shape)} voxels, up to "
            f"{self.values.max():.4g}>"
        )

    def means(
        self, lower: ArrayLike, spacing: ArrayLike, shape: tuple[int, int, int]
    ) -> NDArray[np.float64]:
        """Return the mean extinction in each voxel of another box, ``shape``.

        Parameters
        ----------
        lower : (3,)
            The other box's lower corner.
        spacing : (3,)
        shape : (int, int, int)

        Notes
        -----
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
