"""What the views resolve: how they cover the voxels, and how wide one voxel's light comes back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.check.coverage import coverage
from rigs.check.resolved_wavelength import ResolvedWavelength, box_covariance
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.uncertainty.residual_noise import Solve

REACH = 4
"""Voxels from a spot out to which its light is measured."""

SPACING = 2 * REACH + 1
"""Voxels between neighbouring spots along each axis: each has its own around it."""

BRIGHTNESS = 0.1
"""Brightness of a spot, as a fraction of the brightest voxel: a small change of the volume."""

PIXEL = (8 * np.log(2) / 12) ** 0.5
"""Full width at half maximum of the Gaussian with the variance of a box of width 1."""


@dataclass(frozen=True, eq=False)
class Resolution:
    """The widths of reconstructed spots of one voxel."""

    grid: VoxelGrid
    spots: NDArray[np.int64]  # (n,): flat voxel numbers
    widths: NDArray[np.float64]
    """(n, 3): full widths at half maximum along x, y, z in voxels, at most ``2 REACH``."""

    def report(self) -> Mapping[str, Any]:
        """Return medians and 90 % quantiles, in voxels and in the grid's unit."""
        median = np.median(self.widths, axis=0)
        worst = np.quantile(self.widths, 0.9, axis=0)
        return {
            "spots": len(self.spots),
            "voxels": median.tolist(),
            "length": (median * self.grid.spacing).tolist(),
            "widest_tenth_voxels": worst.tolist(),
            "widest_tenth_length": (worst * self.grid.spacing).tolist(),
            "at_most_voxels": 2 * REACH,
        }


def resolution(
    system: LinearSystem,
    measured: NDArray[np.float32],
    volume: NDArray[np.float32],
    emitting: NDArray[np.bool_],
    solve: Solve,
    pixel: float = 0.0,
) -> Resolution | None:
    """Return the widths of reconstructed spots of one voxel; None where no voxel emits.

    The projections of faint spots, one ``emitting`` voxel each and far apart, are added to the
    images, and the reconstruction is done again: its change is the local point-spread function of
    the method as it is, non-negativity and early stopping included, at these images. The width is
    where the change falls to half of what it is at the spot, interpolated along each axis. A pixel
    gathers light over its width, ``pixel`` in the grid's unit, which the equations' single rays do
    not: it is added in squares. What noise hides is not in it.
    """
    spots = _spots(system, emitting)
    if not len(spots):
        return None
    active = system.projector.active
    added = np.zeros(system.projector.shape[1], np.float32)
    added[spots] = BRIGHTNESS * float(volume.max())
    change = solve((measured + system.projector @ added).astype(np.float32)) - volume
    response = active.expand(change.astype(np.float64)).reshape(active.grid.shape)
    flat = spots if active.index is None else active.index[spots]
    places = np.stack(np.unravel_index(flat, response.shape), axis=-1)  # (n, 3)
    widths = np.array([half_widths(response, tuple(place)) for place in places])
    own = PIXEL * (pixel if np.isfinite(pixel) else 0.0) / np.asarray(active.grid.spacing)
    return Resolution(active.grid, flat, np.minimum(np.hypot(widths, own), 2.0 * REACH))


def half_widths(response: NDArray[np.float64], place: tuple[int, int, int]) -> NDArray[np.float64]:
    """Return the full width at half of the value at ``place`` along each axis, in voxels: (3,).

    Values between voxels are interpolated, those outside the grid are zero; at most ``2 REACH``.
    """
    padded = np.pad(response, REACH + 1)
    x, y, z = place
    place = x + REACH + 1, y + REACH + 1, z + REACH + 1
    widths = np.full(3, 2.0 * REACH)
    if not padded[place] > 0:
        return widths
    for axis in range(3):
        line = padded[tuple(slice(None) if a == axis else place[a] for a in range(3))]
        line = line / padded[place]
        at = place[axis]
        sides = (line[at : at + REACH + 1], line[at - REACH : at + 1][::-1])
        widths[axis] = sum(_to_half(side) for side in sides)
    return widths


def _to_half(falling: NDArray[np.float64]) -> float:
    """Return the distance at which values first fall from 1 to a half; `REACH` at most."""
    below = np.flatnonzero(falling < 0.5)
    if not len(below):
        return float(REACH)
    after = below[0]
    before, behind = falling[after - 1], falling[after]
    return float(after - 1 + (before - 0.5) / (before - behind))


def _spots(system: LinearSystem, emitting: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the unknowns on the lattice that hits the most emitting voxels."""
    active = system.projector.active
    bright = np.flatnonzero(emitting)
    flat = bright if active.index is None else active.index[bright]
    offsets = [index % SPACING for index in np.unravel_index(flat, active.grid.shape)]
    lattice = np.ravel_multi_index(offsets, (SPACING,) * 3)
    if not len(bright):
        return bright
    return bright[lattice == np.bincount(lattice).argmax()]


EMITTING = 0.01
"""Fraction of the brightest voxel above which a voxel counts as emitting."""

SAMPLED = 150
"""Emitting voxels, spread evenly, at which details and pixel sizes are computed."""


@dataclass(frozen=True, eq=False)
class AngularCoverage:
    """How the views cover the unknowns."""

    views: NDArray[np.int64]  # (unknowns,): views with a usable pixel whose rays cross the voxel
    emitting: NDArray[np.bool_]  # (unknowns,): above `EMITTING` times the brightest
    resolved: ResolvedWavelength | None
    """Details that the views measure; None where no voxel emits."""
    pixel: float
    """Median size at emitting voxels, across the line of sight, in rig's unit; NaN if unknown."""
    length_unit: str

    @property
    def median_views(self) -> float:
        """Median number of views of the emitting voxels; NaN where none emits."""
        seen = self.views[self.emitting]
        return float(np.median(seen)) if len(seen) else float("nan")

    @property
    def words(self) -> str:
        """The details that the views measure, as a clause; empty where no voxel emits."""
        return "" if self.resolved is None else self.resolved.words(self.length_unit)

    def report(self) -> Mapping[str, Any]:
        """Return the counts of voxels by views, and the details that the views measure."""
        numbers, counts = np.unique(self.views, return_counts=True)
        bright, bright_counts = np.unique(self.views[self.emitting], return_counts=True)
        return {
            "emitting": int(np.count_nonzero(self.emitting)),
            "by_views": dict(zip(numbers.tolist(), counts.tolist(), strict=True)),
            "emitting_by_views": dict(zip(bright.tolist(), bright_counts.tolist(), strict=True)),
            "median_views": self.median_views,
            "resolved_wavelength": self.resolved
            and {**self.resolved.report(), "in_words": self.words},
        }


def view_coverage(system: LinearSystem, volume: NDArray[np.float32]) -> AngularCoverage:
    """Return how the views of a system cover its unknowns.

    ``volume`` (unknowns,) shows the emitting voxels.
    """
    projector = system.projector
    brightest = float(np.max(volume, initial=0.0))
    emitting = volume > EMITTING * brightest  # (unknowns,)
    bright = np.flatnonzero(emitting)
    sample = bright[np.linspace(0, len(bright) - 1, min(SAMPLED, len(bright))).astype(np.int64)]
    views = np.zeros(projector.shape[1], np.int64)
    seen = np.zeros((len(sample), projector.n_views), bool)
    for number in range(projector.n_views):
        crossed = projector.view(number).column_sums > 0
        views += crossed
        seen[:, number] = crossed[sample]
    unit = system.rig.length_unit
    if not len(sample):
        return AngularCoverage(views, emitting, None, math.nan, unit)
    grid = projector.active.grid
    found = coverage(system.rig, _centers(system, sample))
    sight = found.views_of(
        _emission_covariance(system, bright, volume[bright]),
        float(np.prod(grid.spacing)) ** (1 / 3),
    )
    resolved = replace(sight, seen=seen).resolved()
    sizes = found.median_footprint
    known = np.isfinite(sizes)
    pixel = float(np.median(sizes[known])) if known.any() else math.nan
    return AngularCoverage(views, emitting, resolved, pixel, unit)


def _emission_covariance(
    system: LinearSystem, unknowns: NDArray[np.int64], emission: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the covariance ``(3, 3)`` of the places that light comes from."""
    points, weights = _centers(system, unknowns), emission.astype(np.float64)
    covariance = np.cov(points.T, aweights=weights, ddof=0)
    return covariance + box_covariance(system.projector.active.grid.spacing)  # within a voxel


def _centers(system: LinearSystem, unknowns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the centres of some unknowns, ``(n, 3)``."""
    active = system.projector.active
    flat = unknowns if active.index is None else active.index[unknowns]
    index = np.unravel_index(flat, active.grid.shape)
    return np.stack([axis[i] for axis, i in zip(active.grid.axes(), index, strict=True)], axis=-1)
