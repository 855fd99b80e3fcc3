"""Gas that absorbs: rays whose segments count by the fraction of their light that arrives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.attenuation import dimming, transmission
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
    some = None if active is None or active.all or absorption.extinction is None else active
    if some is not None and emission is not None:
        emission = some.expand(emission)
    follow = _followed(grid, absorption, emission, tracer, active if some is None else None)

    def traced(rays: Rays) -> Segments:
        plain, arriving = follow(rays)
        found = Segments(plain.ptr[rays.pixel_ptr], plain.voxel, plain.length * arriving)
        return found if some is None else found.renumbered(some.number)

    return traced


def dimmed(
    grid: VoxelGrid,
    absorption: Absorption,
    volume: NDArray[np.floating],
    emission: NDArray[np.floating] | None = None,
    *,
    tracer: str = "march",
) -> Tracer:
    """Return the tracer whose lengths are the change of a pixel by more extinction in a voxel.

    Parameters
    ----------
    grid : VoxelGrid
    absorption : Absorption
        Of the gas that is there already.
    volume : (voxels,)
        The unknowns whose light is dimmed, zero where none is.
    emission : (voxels,), optional
        That in the exponent, see `attenuating`.
    tracer : str
        See `tomo.trace.trace`.
    """
    follow = _followed(grid, absorption, emission, tracer, None)

    def traced(rays: Rays) -> Segments:
        plain, arriving = follow(rays)
        change = dimming(plain, rays, plain.length * arriving * volume[plain.voxel])
        return Segments(plain.ptr[rays.pixel_ptr], plain.voxel, change)

    return traced


def _followed(
    grid: VoxelGrid,
    absorption: Absorption,
    emission: NDArray[np.floating] | None,
    tracer: str,
    active: ActiveVoxels | None,
) -> Callable[[Rays], tuple[Segments, NDArray[np.floating]]]:
    """Return what takes rays to the segments of their pieces, and the fraction that arrives."""
    strengths, extinction = (absorption.medium, absorption.emission), absorption.extinction
    find = tracing(grid, tracer, midpoints=True, active=active)
    given = None if extinction is None else extinction_on_grid(extinction, grid)

    def follow(rays: Rays) -> tuple[Segments, NDArray[np.floating]]:
        plain = find(replace(rays, pixel_ptr=np.arange(len(rays) + 1), path_ptr=None))
        outside = None if extinction is None else depth_around(extinction, rays, grid)
        return plain, transmission(
            plain, rays, grid, *strengths, emission, extinction=given, outside=outside
        )

    return follow


@lru_cache(maxsize=2)
def extinction_on_grid(extinction: ExtinctionVolume, grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the mean extinction in each voxel of a grid, ``(voxels,)``."""
    return extinction.means(grid.lower, grid.spacing, grid.shape).ravel()


def depth_around(
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
