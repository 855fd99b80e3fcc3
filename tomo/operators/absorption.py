"""Light through gas that absorbs: the fraction that arrives, and what more gas would change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo._compute.threads import run_ranges
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.rays import Rays
from tomo.rays.ray_box import enter_box
from tomo.trace import Segments, trace, tracing

if TYPE_CHECKING:
    from rigs import Rig
    from rigs.scene.gas import ExtinctionVolume


def transmission(
    segments: Segments,
    rays: Rays,
    grid: VoxelGrid,
    absorption: float,
    self_absorption: float,
    emission: NDArray[np.floating] | None,
    *,
    extinction: NDArray[np.floating] | None = None,
    outside: NDArray[np.float64] | None = None,
) -> NDArray[np.floating]:
    """Return the fraction of the light of every segment that leaves the grid: ``(segments,)``.

    ``exp(-k d - sum_n (q E_n + k_n) l_n - (q E + k_s) l / 2)``, with ``k`` ``absorption``, in 1 /
    length, and ``q`` ``self_absorption``, in 1 / (emission * length): ``d`` is the way in the grid
    from the camera to the segment's midpoint; the sum is over the segments of the path before it.
    Half of the segment's own depth makes a ray's integral accurate to second order in voxels.

    ``segments`` are those of ``rays``, with midpoints and one piece a row; rays are paths from the
    camera on, none of weight zero. ``emission`` (voxels,) is needed where ``q`` is not zero,
    ``extinction`` (voxels,) is ``k_n``. ``outside`` (pieces, 2) are the optical depths of each
    piece before it enters the grid, and after it leaves it.
    """
    box = enter_box(rays, grid)
    entry = box.position * grid.spacing - grid.extent / 2  # (pieces, 3)
    near = np.einsum("ij,ij->i", entry, rays.directions)
    nothing = np.zeros(0, np.float32)
    used = nothing
    if self_absorption != 0:
        used = cast("NDArray[np.floating]", emission).ravel()
    given = nothing if extinction is None else extinction
    beyond = np.zeros((0, 2)) if outside is None else outside
    paths = rays.paths
    through = np.zeros_like(segments.length)

    def transmit(first: int, last: int) -> None:
        _transmit(
            segments.ptr, segments.voxel, segments.length, segments.midpoint, rays.directions,
            rays.weight, near, box.length, used, given, beyond, float(absorption),
            float(self_absorption), paths, first, last, through,
        )  # fmt: skip

    run_ranges(len(paths) - 1, transmit)
    return through


def dimming(segments: Segments, rays: Rays, light: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the change of every ray by a unit of extinction in each segment: ``(segments,)``.

    ``light`` (segments,) is what arrives of every segment's, times the ray's weight. The
    derivative of ``sum_s I_s exp(-sum_n k_n l_n - k_s l_s / 2)`` by ``k_n`` is minus ``l_n`` times
    the light that arrives from behind segment ``n``, with half of its own.
    """
    paths, change = rays.paths, np.zeros_like(segments.length)

    def dim(first: int, last: int) -> None:
        _dim(segments.ptr, segments.length, rays.weight, light, paths, first, last, change)

    run_ranges(len(paths) - 1, dim)
    return change


@compiled()
def _dim(ptr, length, weights, light, path_ptr, first, last, change):
    """Walk some paths towards the camera and add up the light from behind each segment."""
    for path in range(first, last):
        behind = 0.0
        for ray in range(path_ptr[path + 1] - 1, path_ptr[path] - 1, -1):
            for s in range(ptr[ray + 1] - 1, ptr[ray] - 1, -1):
                change[s] = -length[s] / weights[ray] * (behind + light[s] / 2)
                behind += light[s]


@compiled()
def _transmit(
    ptr, voxel, length, midpoint, directions, weights, near, inside, emission, extinction,
    outside, absorption, self_absorption, path_ptr, first, last, through,
):  # fmt: skip
    """Walk some paths from the camera on and add up the optical depth before each segment."""
    for path in range(first, last):
        before = 0.0
        for ray in range(path_ptr[path], path_ptr[path + 1]):
            dx, dy, dz = directions[ray]
            strength = self_absorption / weights[ray]  # lengths hold the weight already
            before += outside[ray, 0] if len(outside) > 0 else 0.0
            passed = before - absorption * near[ray]
            for s in range(ptr[ray], ptr[ray + 1]):
                along = dx * midpoint[s, 0] + dy * midpoint[s, 1] + dz * midpoint[s, 2]
                own = strength * emission[voxel[s]] * length[s] if len(emission) > 0 else 0.0
                if len(extinction) > 0:
                    own += extinction[voxel[s]] * length[s] / weights[ray]
                through[s] = np.exp(-(absorption * along + passed + own / 2))
                passed += own
            before = passed + absorption * (near[ray] + inside[ray])
            before += outside[ray, 1] if len(outside) > 0 else 0.0


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
    ``c = q E + k_n`` (`tomo.operators.absorption`): linear in the unknowns ``x`` once the
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

    ``emission`` (unknowns,) of the active voxels is needed where ``absorption.emission`` is not 0.
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
) -> Tracer:
    """Return the tracer whose lengths are the change of a pixel by more extinction in a voxel.

    ``volume`` (voxels,) are the unknowns whose light is dimmed by more than the gas that is there
    already; ``emission`` (voxels,) as of `attenuating`.
    """
    follow = _followed(grid, absorption, emission, "march", None)

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
