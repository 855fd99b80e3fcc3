"""Gas of a scene: a refractive index that bends light, an extinction that takes it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from rigs.geometry.points import box_points
from rigs.scene.gas.extinction_volume import ExtinctionVolume
from rigs.scene.gas.index_field import IndexField

_ALONG = 9
"""Points along each edge of the box that are looked up in solids."""


class SolidLike(Protocol):
    """A solid, as far as gas has to know it."""

    @property
    def name(self) -> str:
        """Unique in a scene."""

    def contains(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether points ``(N, 3)`` are inside, ``(N,)``."""

    def samples(self) -> NDArray[np.float64]:
        """Return points on its surface, ``(N, 3)``."""


@dataclass(frozen=True)
class Gas:
    """Gas in the light's way.

    Attributes
    ----------
    index : IndexField, optional
        None: gas that does not bend light.
    extinction : ExtinctionVolume, optional
        None: gas that does not absorb.

    Examples
    --------
    >>> Gas(extinction=ExtinctionVolume(np.full((1, 1, 1), 0.02), (-20, -20, 0), (40, 40, 90)))
    Gas(index=None, extinction=<ExtinctionVolume: 1x1x1 voxels, up to 0.02>)
    """

    index: IndexField | None = None
    extinction: ExtinctionVolume | None = None

    def __bool__(self) -> bool:
        """Whether there is any gas."""
        return self.index is not None or self.extinction is not None

    def check(self, solids: Iterable[SolidLike], medium: float = 1.0) -> None:
        """Raise if the gas does not fit the scene that it is in.

        Parameters
        ----------
        solids : iterable of SolidLike
        medium : float
            The scene's refractive index.

        Raises
        ------
        ValueError
            If the index is another one at the box's faces than the scene's, or a solid reaches
            into the box: rays in it are followed through gas alone.
        """
        if self.index is None:
            return
        own = getattr(self.index, "medium", medium)
        if abs(own - medium) > 1e-12:
            raise ValueError(
                f"gas: index: found {own:.6g} at its faces in a medium of {medium:.6g}, expected "
                "one index"
            )
        low, high = self.index.lower, self.index.upper
        for solid in solids:
            if reaches_into(solid, low, high):
                found = ", ".join(f"{a:.4g} to {b:.4g}" for a, b in zip(low, high, strict=True))
                raise ValueError(
                    f"gas: solid {solid.name}: reaches into the box of the refractive index, "
                    f"x, y, z from {found}, expected solids outside: make the box smaller"
                )

    def transformed(self, R: NDArray[np.float64], t: NDArray[np.float64]) -> Self:
        """Return the gas after the rigid motion ``x_new = R @ x_old + t`` of the world."""
        return replace(
            self,
            index=self.index and self.index.transformed(R, t),
            extinction=self.extinction and self.extinction.transformed(R, t),
        )

    def with_lengths_scaled(self, factor: float) -> Self:
        """Return the gas of a world whose lengths are ``factor`` times as large."""
        return replace(
            self,
            index=self.index and self.index.with_lengths_scaled(factor),
            extinction=self.extinction and self.extinction.with_lengths_scaled(factor),
        )


def reaches_into(solid: SolidLike, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Return whether a solid has points in a box, or points of the box are in the solid."""
    points = solid.samples()
    inside = ((points > low) & (points < high)).all(axis=1)
    return bool(inside.any() or solid.contains(box_points(low, high, _ALONG)).any())
