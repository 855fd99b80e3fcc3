"""The views that cross each emitting voxel, and the details that they measure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.check.coverage import coverage
from rigs.check.resolved_wavelength import ResolvedWavelength, box_covariance
from tomo.operators import LinearSystem

EMITTING = 0.01
"""Fraction of the brightest voxel above which a voxel counts as emitting."""

SAMPLED = 150
"""Emitting voxels, spread evenly, at which details and pixel sizes are computed."""


@dataclass(frozen=True, eq=False)
class AngularCoverage:
    """How the views cover the unknowns.

    Attributes
    ----------
    views : (unknowns,) int64
        Views with a usable pixel whose rays cross the voxel.
    emitting : (unknowns,) bool
        True above `EMITTING` times the brightest voxel.
    resolved : ResolvedWavelength, optional
        The details that the views measure of the emission; None where no voxel emits.
    pixel : float
        Median pixel size at emitting voxels, across the line of sight, in the rig's unit; NaN if
        unknown.
    length_unit : str
    """

    views: NDArray[np.int64]
    emitting: NDArray[np.bool_]
    resolved: ResolvedWavelength | None
    pixel: float
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

    Parameters
    ----------
    system : LinearSystem
    volume : (unknowns,) float32
        The reconstruction, which shows the emitting voxels.
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
