"""The uncertainty report: angular coverage, standard deviation by noise, resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.operators.system import Progress
from tomo.uncertainty.bootstrap import KEPT, Deviations, standard_deviations
from tomo.uncertainty.intervals import Intervals, deviations_of_pair, intervals
from tomo.uncertainty.moved import solve_moved
from tomo.uncertainty.part import SolveOf, slab, whole
from tomo.uncertainty.residual_noise import (
    MOST_FITTED,
    Solve,
    fine_structure,
    noise_of_images,
    smoothed,
)
from tomo.uncertainty.resolution import (
    EMITTING,
    AngularCoverage,
    Resolution,
    resolution,
    view_coverage,
)

AUTO_REPEATS = 2
"""Repeats of a known answer, with noise of either sign: no map of single voxels."""

MAPPED = 10
"""Repeats from which on single voxels' standard deviations, then known to a quarter, are shown."""

_DEVIATION_WORDS = (
    "the chosen solve is repeated on re-projected images with new noise of the level found in "
    "the residual (two repeats are of the volume, turned; half of 20 or more calibrate the "
    "others); errors by smoothing, missing "
    "views and wrong cameras are not included, nor noise that neighbouring pixels share, as in "
    "resampled images"
)
_KNOWN = "errors of a known answer"

_RESOLUTION_WORDS = (
    "faint spots of one voxel are added to the images and the volume is solved again; the full "
    "width at half maximum of the change, with the pixels' width added in quadrature"
)


@dataclass(frozen=True, eq=False)
class Assessment:
    """How far a reconstruction can be trusted.

    ``residual`` and ``noise`` are root mean squares of the images' over that of the images; NaN
    where unknown, and for dark images.
    """

    active: ActiveVoxels  # the unknowns
    volume: NDArray[np.float32]  # (unknowns,)
    coverage: AngularCoverage
    residual: float
    noise: float
    deviations: Deviations | None = None  # None if the reconstruction was not repeated
    resolution: Resolution | None = None  # None if it was not measured, or nothing emits
    intervals: Intervals | None = None  # None where too few voxels emit

    def __repr__(self) -> str:
        """Name the size and the deviation by noise."""
        return f"<Assessment of {self.active.size} unknowns: noise {self.relative_deviation:.1%}>"

    @property
    def relative_deviation(self) -> float:
        """Root mean square standard deviation of the emitting voxels over their emission's."""
        if self.deviations is None:
            return math.nan
        emitting = self.coverage.emitting
        size = norm(self.volume[emitting])
        return norm(self.deviations.values[emitting]) / size if size > 0 else math.nan

    @property
    def mapped(self) -> bool:
        """Whether the standard deviations of single voxels are known well enough to show."""
        return self.deviations is not None and self.deviations.repeats >= MAPPED

    @property
    def half_width(self) -> NDArray[np.float32] | None:
        """The half-width of every voxel's 90 % interval ``(nx, ny, nz)``, zero where inactive."""
        return None if self.intervals is None else self.intervals.half_width

    @property
    def standard_deviation(self) -> NDArray[np.float32] | None:
        """The standard deviation of every voxel ``(nx, ny, nz)``, zero for inactive voxels."""
        if self.deviations is None:
            return None
        return self.active.expand(self.deviations.values).reshape(self.active.grid.shape)

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``condition``.

        ``voxels``
            ``emitting`` (above a hundredth of the brightest), counts of unknowns and of emitting
            voxels by number of views, and ``resolved_wavelength``: see `ResolvedWavelength`.
        ``images``
            ``residual`` and ``noise`` relative to the images, and the first over the second.
        ``standard_deviation``
            ``relative`` (root mean square over that of the emission, emitting voxels), ``median``
            and ``largest`` of emitting voxels in the volume's unit, ``share_above_half`` (emitting
            voxels with more than half of their value), ``repeats``, ``scatter`` (relative standard
            error of a single voxel's).
        ``resolution``
            ``voxels`` and ``length`` along x, y, z: medians of full widths at half maximum.
        ``intervals``
            Half-widths of 90 % intervals of voxels, total, plane sums and edges, see `Intervals`.
        """
        known = not math.isnan(self.noise)
        return {
            "voxels": self.coverage.report(),
            "images": {
                "residual": self.residual,
                "noise": self.noise,
                "residual_over_noise": self.residual / self.noise
                if known and self.noise > 0
                else math.nan,
            },
            "standard_deviation": self._of_deviations(),
            "resolution": None
            if self.resolution is None
            else {**self.resolution.report(), "method": _RESOLUTION_WORDS},
            "intervals": self.intervals
            and self.intervals.report(self.volume, self.coverage.emitting),
        }

    def _of_deviations(self) -> dict[str, Any] | None:
        if self.deviations is None:
            return None
        emitting = self.coverage.emitting
        values, volume = self.deviations.values[emitting], self.volume[emitting]
        return {
            "relative": self.relative_deviation,
            "median": float(np.median(values)) if len(values) else math.nan,
            "largest": float(values.max(initial=0.0)),
            "share_above_half": float(np.mean(values > volume / 2)) if len(values) else math.nan,
            "repeats": self.deviations.repeats,
            "scatter": self.deviations.scatter,
            "mapped": self.mapped,
            "method": _DEVIATION_WORDS,
        }


def assess(
    system: LinearSystem,
    measured: NDArray[np.float32],
    volume: NDArray[np.float32],
    solve: Solve | None = None,
    *,
    solve_of: SolveOf | None = None,
    cuttable: ProjectionOperator | None = None,
    light_error: float = 0.0,
    repeats: int = AUTO_REPEATS,
    seed: int = 0,
    progress: Progress | None = None,
) -> Assessment:
    """Return how far a reconstruction can be trusted.

    ``system`` is the one that was solved, on voxel means, ``measured`` (pixels,) the images, gains
    corrected. Without a ``solve`` to repeat there is no standard deviation and no resolution.
    ``solve_of`` is the same from a start of its own, also of a part of the volume. Parts are cut
    from ``cuttable``: `AUTO_REPEATS` repeats are then those of a slab. ``light_error`` is the
    relative standard deviation of the total light by what was found of cameras and gas.
    ``repeats``, 0 or from 2 on, are with new noise; one more solve measures the resolution, and
    more than `AUTO_REPEATS` are solves of the whole volume beside these.
    """
    if not (repeats == 0 or repeats >= AUTO_REPEATS) or repeats % 1:
        raise ValueError(f"uncertainty: found {repeats} repeats, expected 0, or 2 or more")
    active = system.projector.active
    unknowns = active.compress(volume)
    seen = (system.projector @ unknowns).astype(np.float32)
    found = view_coverage(system, unknowns)
    size = norm(measured)
    residual = norm(measured - seen) / size if size > 0 else math.nan
    noise = fine_structure(system, measured, seen, seen)
    if solve is None or not repeats or not size > 0 or not found.emitting.any():
        noise = noise_of_images(system, measured, seen)
        share = norm(noise) / size if size > 0 else math.nan
        return Assessment(active, unknowns, found, residual, share)
    if cuttable is not None and solve_of is not None and repeats == AUTO_REPEATS:
        part = slab(system, volume, solve_of, cuttable)
    else:
        part = whole(system, solve if solve_of is None else solve_of(None, None))
    if progress:
        progress(0, 3, _KNOWN)
    explained = (norm(noise) / (residual * size)) ** 2 if residual > 0 else 1.0
    unexplained = residual * math.sqrt(max(1 - explained, 0.0))
    kept = part.pixels(smoothed(system, measured - seen, KEPT))
    moved = solve_moved(part, volume, kept, part.pixels(noise), seed)
    emission = float(np.sqrt(np.mean(np.square(unknowns[found.emitting], dtype=np.float64))))
    if progress:
        progress(2, 3, "resolution")
    first = moved.found[0]
    where = part.inside & (first > EMITTING * first.max())
    own = part.system.projector.active
    width = resolution(
        part.system,
        moved.images,
        own.compress(first),
        own.compress(where),
        part.solve,
        found.pixel,
    )
    noise = noise_of_images(system, measured, seen, moved.remains)
    if repeats > AUTO_REPEATS:
        deviations = standard_deviations(
            system, measured, seen, noise, solve, repeats=repeats, seed=seed, progress=progress
        )
    else:
        spread = deviations_of_pair(moved, volume, where, emission) / max(
            moved.remains, 1 - MOST_FITTED
        )
        values = active.compress(spread).astype(np.float32)
        deviations = Deviations(values, repeats, noise)
    if progress:
        progress(3, 3, "intervals")
    known = intervals(
        system,
        measured,
        seen,
        volume,
        deviations.values,
        moved,
        where,
        emission,
        unexplained,
        light_error,
    )
    share = norm(noise) / size
    return Assessment(active, unknowns, found, residual, share, deviations, width, known)
