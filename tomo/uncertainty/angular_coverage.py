"""The views that cross each emitting voxel, and the angular gaps between them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.check.angular_gap import largest_gap, lines_of_sight
from rigs.check.coverage import coverage
from tomo.operators import LinearSystem

EMITTING = 0.01
"""Fraction of the brightest voxel above which a voxel counts as emitting."""

SAMPLED = 150
"""Emitting voxels, spread evenly, at which angular gaps and pixel sizes are computed."""

SAME_LINE = 5.0
"""Degrees up to which two views share a line of sight. Opposite views measure the same integral:
an even ring of cameras has half as many lines."""

GAP_EDGES = (0.0, 15.0, 30.0, 45.0, 60.0, 90.0, 180.0)
"""Edges, in degrees, of the histogram of gaps."""


@dataclass(frozen=True, eq=False)
class AngularCoverage:
    """How the views cover the unknowns.

    Attributes
    ----------
    views : (unknowns,) int64
        Views with a usable pixel whose rays cross the voxel.
    emitting : (unknowns,) bool
        True above `EMITTING` times the brightest voxel.
    lines : (samples,) int64
        Lines of sight through sampled emitting voxels, see `SAME_LINE`.
    gap : (samples,) float64
        Largest angular gap at the same voxels, in degrees, see `rigs.check.angular_gap`.
    pixel : float
        Median pixel size there, across the line of sight, in the rig's unit; NaN if unknown.
    """

    views: NDArray[np.int64]
    emitting: NDArray[np.bool_]
    lines: NDArray[np.int64]
    gap: NDArray[np.float64]
    pixel: float

    @property
    def median_views(self) -> float:
        """Median number of views of the emitting voxels; NaN where none emits."""
        seen = self.views[self.emitting]
        return float(np.median(seen)) if len(seen) else float("nan")

    @property
    def median_sight_lines(self) -> float:
        """Median number of lines of sight of emitting voxels; NaN where none emits."""
        return float(np.median(self.lines)) if len(self.lines) else float("nan")

    @property
    def median_gap(self) -> float:
        """Median angular gap in degrees; NaN where no voxel emits."""
        return float(np.median(self.gap)) if len(self.gap) else float("nan")

    def report(self) -> Mapping[str, Any]:
        """Return the counts of voxels by views and by gap."""
        numbers, counts = np.unique(self.views, return_counts=True)
        bright, bright_counts = np.unique(self.views[self.emitting], return_counts=True)
        fractions = np.histogram(self.gap, GAP_EDGES)[0] / max(len(self.gap), 1)
        return {
            "emitting": int(np.count_nonzero(self.emitting)),
            "by_views": dict(zip(numbers.tolist(), counts.tolist(), strict=True)),
            "emitting_by_views": dict(zip(bright.tolist(), bright_counts.tolist(), strict=True)),
            "median_views": self.median_views,
            "median_lines": self.median_sight_lines,
            "gap_edges_degrees": list(GAP_EDGES),
            "emitting_share_by_gap": fractions.tolist(),
            "median_gap_degrees": self.median_gap,
            "sampled": len(self.gap),
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
    if not len(sample):
        return AngularCoverage(views, emitting, np.zeros(0, np.int64), np.zeros(0), float("nan"))
    points = _centers(system, sample)
    found = coverage(system.rig, points)
    lines = lines_of_sight(found.directions, seen, SAME_LINE)
    gap, _ = largest_gap(found.directions, seen)
    sizes = found.median_footprint
    known = np.isfinite(sizes)
    pixel = float(np.median(sizes[known])) if known.any() else math.nan
    return AngularCoverage(views, emitting, lines, gap, pixel)


def _centers(system: LinearSystem, unknowns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the centres of some unknowns, ``(n, 3)``."""
    active = system.projector.active
    flat = unknowns if active.index is None else active.index[unknowns]
    index = np.unravel_index(flat, active.grid.shape)
    return np.stack([axis[i] for axis, i in zip(active.grid.axes(), index, strict=True)], axis=-1)
