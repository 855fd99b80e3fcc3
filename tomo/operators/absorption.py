"""Gas that absorbs: rays whose segments count by the fraction of their light that arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.attenuation import transmission
from tomo.rays import Rays
from tomo.rays.ray_box import enter_box
from tomo.trace import Segments, trace, tracing

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.scene.gas import ExtinctionVolume

Tracer = Callable[[Rays], Segments]


@dataclass(frozen=True)
class Absorption:
    """How strongly the gas in the grid absorbs.

    Attributes
    ----------
    medium : float
        ``k`` of an even medium that fills the grid, in 1 / length.
    emission : float
        ``q`` of gas that absorbs in proportion to its emission, in 1 / (emission * length).
    extinction : ExtinctionVolume, optional
        ``k_n`` of gas that is known, in 1 / length: its means over the grid's voxels, and what
        is around the grid.

    Notes
    -----
    A pixel shows ``sum_s l_s exp(-k d_s - sum_n c_n l_n - c_s l_s / 2) x_s`` with
    ``c = q E + k_n`` (`tomo.operators.attenuation`): linear in the unknowns ``x`` once the
    emission ``E`` in the exponent is given. Outer iterations make both the same.

    Raises
    ------
    ValueError
        If one is negative or not finite.
    """

    medium: float = 0.0
    emission: float = 0.0
    extinction: ExtinctionVolume | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ("medium", "emission"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise ValueError(
                    f"absorption {name}: found {value}, expected a finite number >= 0"
                )

    def __bool__(self) -> bool:
        """Whether anything absorbs."""
        return bool(self.medium > 0 or self.emission > 0 or self.extinction is not None)

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        found: dict[str, Any] = {"medium": self.medium, "emission": self.emission}
        if self.extinction is not None:
            found["extinction"] = {"largest": float(self.extinction.values.max())}
        return found


TRANSPARENT = Absorption()
"""Gas that absorbs nothing."""


def extinction_of(rig: Rig) -> ExtinctionVolume | None:
    """Return the extinction of the gas in a rig's scene; None where there is none."""
    gas = None if rig.scene is None else rig.scene.gas
    return None if gas is None else gas.extinction


def attenuating(
    grid: VoxelGrid,
    absorption: Absorption,
    emission: NDArray[np.floating] | None = None,
    *,
    tracer: str = "march",
    active: ActiveVoxels | None = None,
) -> Tracer:
    """Return the tracer whose lengths are times the fraction of light that arrives.

    Parameters
    ----------
    grid : VoxelGrid
    absorption : Absorption
    emission : (unknowns,), optional
        Of the active voxels; needed where ``absorption.emission`` is not 0.
    tracer, active
        See `tomo.trace.trace`.

    Notes
    -----
    Gas with a given extinction absorbs in all voxels, whether they are active or not: rays are
    then followed through all, and segments in others are left out afterwards.
    """
    strengths, extinction = (absorption.medium, absorption.emission), absorption.extinction
    some = None if active is None or active.all or extinction is None else active
    find = tracing(grid, tracer, midpoints=True, active=active if some is None else None)
    if some is not None and emission is not None:
        emission = some.expand(emission)
    given = None if extinction is None else _on_grid(extinction, grid)

    def traced(rays: Rays) -> Segments:
        plain = find(replace(rays, pixel_ptr=np.arange(len(rays) + 1), path_ptr=None))
        outside = None if extinction is None else _around(extinction, rays, grid)
        arriving = transmission(
            plain, rays, grid, *strengths, emission, extinction=given, outside=outside
        )
        found = Segments(plain.ptr[rays.pixel_ptr], plain.voxel, plain.length * arriving)
        return found if some is None else found.renumbered(some.number)

    return traced


@lru_cache(maxsize=2)
def _on_grid(extinction: ExtinctionVolume, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the mean extinction in each voxel of a grid, ``(voxels,)``."""
    return extinction.means(grid.lower, grid.spacing, grid.shape).ravel()


def _around(
    extinction: ExtinctionVolume, rays: Rays, grid: VoxelGrid
) -> NDArray[np.float64] | None:
    """Return the optical depth of pieces before and after the grid, ``(pieces, 2)``.

    None where the gas is in the grid alone.
    """
    low, high = extinction.lower - grid.lower, extinction.upper - grid.upper
    room = 1e-9 * np.asarray(grid.spacing)
    if (low >= -room).all() and (high <= room).all():
        return None
    box = enter_box(rays, grid)
    center = (grid.lower + grid.upper) / 2
    start = (box.position - np.asarray(grid.shape) / 2) * grid.spacing + center - rays.origins
    entry = np.maximum(np.einsum("ij,ij->i", start, rays.directions), 0.0)
    leave = np.minimum(entry + box.length, rays.lengths)
    own = VoxelGrid(
        extinction.values.shape,
        tuple(extinction.spacing),
        tuple((extinction.lower + extinction.upper) / 2),
    )
    parts = (
        Rays.from_lines(rays.origins, rays.directions, entry),
        Rays.from_lines(
            rays.origins + leave[:, None] * rays.directions, rays.directions, rays.lengths - leave
        ),
    )
    values, depths = extinction.values.ravel(), []
    for part in parts:
        found = trace(part, own, dtype=np.float64)
        piece = np.repeat(np.arange(len(rays)), np.diff(found.ptr))
        depths.append(np.bincount(piece, values[found.voxel] * found.length, len(rays)))
    return np.stack(depths, axis=1)
