"""The condition report: what the views see, the noise's share of the volume, the resolution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.operators.system import Progress
from tomo.uncertainty.angular_coverage import Seeing, seeing
from tomo.uncertainty.bootstrap import Deviations, standard_deviations
from tomo.uncertainty.residual_noise import Solve, noise_of_images
from tomo.uncertainty.resolution import Resolution, resolution
from tomo.uncertainty.warnings import doubts

AUTO_REPEATS = 3
"""Enough for what is averaged over the voxels that emit, not for a map of single ones."""

MAPPED = 10
"""From so many repeats on, the deviations of single voxels, known to a quarter, are shown."""

_DEVIATION_WORDS = (
    "repeats of the solve, as it was chosen, on re-projected images with new noise, as large as "
    "that found in the residual (half of 20 or more repeats calibrate the others); what "
    "smoothing, missing views and wrong cameras do to the volume is not in it, nor noise that "
    "neighbouring pixels share, as in resampled images"
)
_RESOLUTION_WORDS = (
    "full width at half maximum of what faint spots of one voxel, added to the images, change in "
    "the volume when it is solved again; the pixels' width is added in squares"
)


@dataclass(frozen=True, eq=False)
class Condition:
    """How far a reconstruction is to be trusted.

    Attributes
    ----------
    active : ActiveVoxels
        The unknowns.
    volume : (unknowns,) float32
    seeing : Seeing
    residual, noise : float
        Root mean square of the images' residual and of their noise, over that of the images; the
        noise is NaN where it is not known, the residual of dark images too.
    deviations : Deviations, optional
        None where the reconstruction was not repeated.
    resolution : Resolution, optional
        None where it was not looked for, or nothing emits.
    """

    active: ActiveVoxels
    volume: NDArray[np.float32]
    seeing: Seeing
    residual: float
    noise: float
    deviations: Deviations | None = None
    resolution: Resolution | None = None

    def __repr__(self) -> str:
        """Say what it is of and how many doubts there are."""
        return f"<Condition of {self.active.size} unknowns: {len(self.warnings)} doubts>"

    @property
    def relative_deviation(self) -> float:
        """Root mean square standard deviation of the emitting voxels over their emission's."""
        if self.deviations is None:
            return math.nan
        emitting = self.seeing.emitting
        size = norm(self.volume[emitting])
        return norm(self.deviations.values[emitting]) / size if size > 0 else math.nan

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why the volume is not to be trusted, one line each."""
        return doubts(self.seeing, self.residual, self.noise, self.relative_deviation)

    @property
    def mapped(self) -> bool:
        """Whether the deviations of single voxels are worth showing."""
        return self.deviations is not None and self.deviations.repeats >= MAPPED

    @property
    def standard_deviation(self) -> NDArray[np.float32] | None:
        """The standard deviation of every voxel ``(nx, ny, nz)``, zero where none is unknown."""
        if self.deviations is None:
            return None
        return self.active.expand(self.deviations.values).reshape(self.active.grid.shape)

    def report(self) -> dict[str, Any]:
        """Return ``report.json``'s ``condition``.

        ``voxels``
            ``emitting`` (above a hundredth of the brightest), counts of unknowns and of emitting
            voxels by number of views, shares of ``sampled`` emitting voxels by angular gap.
        ``images``
            ``residual`` and ``noise`` relative to the images, and the first over the second.
        ``standard_deviation``
            ``relative`` (root mean square over that of the emission, emitting voxels), ``median``
            and ``largest`` of emitting voxels in the volume's unit, ``share_above_half`` (emitting
            voxels with more than half of their value), ``repeats``, ``scatter`` (relative standard
            error of a single voxel's).
        ``resolution``
            ``voxels`` and ``length`` along x, y, z: medians of full widths at half maximum.
        ``warnings``
            Why the volume is not to be trusted; empty where nothing speaks against it.
        """
        known = not math.isnan(self.noise)
        return {
            "voxels": self.seeing.report(),
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
            "warnings": list(self.warnings),
        }

    def _of_deviations(self) -> dict[str, Any] | None:
        if self.deviations is None:
            return None
        emitting = self.seeing.emitting
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
    repeats: int = AUTO_REPEATS,
    seed: int = 0,
    progress: Progress | None = None,
) -> Condition:
    """Return how far a reconstruction is to be trusted.

    Parameters
    ----------
    system : LinearSystem
        What it was reconstructed with.
    measured : (pixels,) float32
        The images that it was reconstructed from, gains corrected.
    volume : (nx, ny, nz) float32
    solve : callable, optional
        The reconstruction. Without it there is neither a standard deviation nor a resolution.
    repeats : int
        How often to repeat it with new noise; two more solves find out how much noise it fits,
        and the resolution. 0: none of these.
    seed : int
        Of the noise.
    progress : callable, optional

    Raises
    ------
    ValueError
        If the number of repeats is negative or 1.
    """
    if not (repeats == 0 or repeats >= 2) or repeats % 1:
        raise ValueError(f"uncertainty: found {repeats} repeats, expected 0, or 2 or more")
    active = system.projector.active
    unknowns = active.compress(volume)
    seen = (system.projector @ unknowns).astype(np.float32)
    found = seeing(system, unknowns)
    size = norm(measured)
    residual = norm(measured - seen) / size if size > 0 else math.nan
    deviations = width = None
    if solve is not None and repeats and size > 0:
        deviations = standard_deviations(
            system, measured, seen, solve, repeats=repeats, seed=seed, progress=progress
        )
        width = resolution(system, measured, unknowns, found.emitting, solve, found.pixel)
    sigma = noise_of_images(system, measured, seen) if deviations is None else deviations.noise
    noise = norm(sigma) / size if size > 0 else math.nan
    return Condition(active, unknowns, found, residual, noise, deviations, width)
