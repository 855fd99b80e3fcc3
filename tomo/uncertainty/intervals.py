"""90 % intervals of voxels, total, plane sums and edges, by the errors of a known answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.uncertainty import summaries
from tomo.uncertainty.moved import Moved, learned

LEVEL = 0.9
NORMAL = round(NormalDist().inv_cdf((1 + LEVEL) / 2), 3)
"""Half-width of the normal distribution's interval of `LEVEL`, in standard deviations."""

DETAIL = 1.6
"""Errors by structure of the emission over those of the known answer: the latter is a
reconstruction, and smoother than what it is of. Less leaves true values outside, more widens."""

UNEXPLAINED = 0.4
"""Growth of the errors with the part of the images that nothing explains, over what the known
answer is off. Less misses cameras that lie, more widens where voxels are coarse."""

LIGHT = 0.2
"""Fraction of the unexplained part of the images that may be light that the volume lacks, or has
too much. Less misses light from outside the grid, more widens all others."""

PLACED = 0.1
"""Half-width, in voxels, that no edge goes below: that of a place within a voxel."""

FEWEST = 20
"""Voxels with errors that sizes can be learned from."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Half-widths of 90 % intervals; together is at least the noise alone.

    ``together² = noise² + structure²``, (unknowns,) each, in the volume's unit. ``growth`` is the
    factor on the voxels' errors for what neither volume nor noise explains of the images: 1 where
    cameras are as exact as those that the known answer was seen by.
    """

    active: ActiveVoxels  # the unknowns, of the voxels' arrays
    noise: NDArray[np.float32]
    structure: NDArray[np.float32]
    together: NDArray[np.float32]
    values: Mapping[str, NDArray[np.float64]]
    """``total`` (), ``plane_sums_x`` (nx,), ``..._y``, ``..._z`` and ``edges`` (3, 2)."""
    half_widths: Mapping[str, NDArray[np.float64]]  # the same for ``values``, together
    noise_of_values: Mapping[str, NDArray[np.float64]]  # the same by noise
    growth: float = 1.0

    @property
    def half_width(self) -> NDArray[np.float32]:
        """The half-width of every voxel's interval, ``(nx, ny, nz)``."""
        return self.active.expand(self.together).reshape(self.active.grid.shape)

    def report(self, volume: NDArray[np.float32], emitting: NDArray[np.bool_]) -> dict[str, Any]:
        """Return ``uncertainty.intervals`` of report.json; see docs/reference/report_json.md."""

        def relative(parts: NDArray[np.float32]) -> float:
            size = norm(volume[emitting])
            return norm(parts[emitting]) / size if size > 0 else math.nan

        spread = self.together[emitting]
        found: dict[str, Any] = {
            "level": LEVEL,
            "camera_groups": 0,  # none is left out
            "voxels": {
                "median_half_width": float(np.median(spread)) if len(spread) else math.nan,
                "relative": relative(self.together),
                "relative_noise": relative(self.noise),
                "relative_structure": relative(self.structure),
                "growth": self.growth,
            },
        }
        for name, value in self.values.items():
            found[name] = {
                "value": value.tolist(),
                "half_width": self.half_widths[name].tolist(),
                "noise": self.noise_of_values[name].tolist(),
            }
        return found


def deviations_of_pair(
    moved: Moved, volume: NDArray[np.float32], where: NDArray[np.bool_], size: float
) -> NDArray[np.float64]:
    """Return the voxels' standard deviations by noise, ``(nx, ny, nz)``, from one known answer.

    ``where`` (nx, ny, nz) are the voxels to learn from, ``size`` is the emission's root mean
    square.
    """
    if np.count_nonzero(where) < FEWEST:
        return np.zeros(volume.shape)
    return learned(list(moved.found), [moved.noise] * 2, where, size, None).of(volume)


def intervals(
    system: LinearSystem,
    measured: NDArray[np.float32],
    seen: NDArray[np.float32],
    volume: NDArray[np.float32],
    deviations: NDArray[np.float32],
    moved: Moved,
    where: NDArray[np.bool_],
    size: float,
    unexplained: float,
    light_error: float = 0.0,
) -> Intervals | None:
    """Return the intervals of a volume; None where too few voxels emit.

    The errors of the known answer, in the voxels ``where`` (nx, ny, nz), are `DETAIL` times those
    that both of its reconstructions have, plus and minus those of the noise. What they follow
    (`tomo.uncertainty.moved`), so that 90 % of them are below, is applied to the volume. It grows
    by `UNEXPLAINED` times the fraction ``unexplained`` of the images, which neither volume nor
    noise explains, of the emission's root mean square ``size`` over the errors', and is at least
    the interval by noise, of ``deviations`` (unknowns,).

    Plane sums have the same errors as those of the known answer, relative to their root mean
    square, and in squares a common factor: the relative difference between the images' light and
    that of their re-projections ``seen``, `LIGHT` times the unexplained part, and ``light_error``,
    the relative standard deviation by what was found of cameras and gas. An edge moves as the sums
    beside it change, over their slope.
    """
    if np.count_nonzero(where) < FEWEST or not moved.truth[where].sum() > 0:
        return None  # in a grid of one layer a moved answer has left it
    active = system.projector.active
    errors = [DETAIL * moved.structure + sign * moved.noise for sign in (1, -1)]
    off = float(np.sqrt(np.mean([np.mean(error[where] ** 2) for error in errors])))
    growth = 1 + UNEXPLAINED * unexplained * size / max(off, np.finfo(float).tiny)
    pattern = growth * learned(list(moved.found), errors, where, size, LEVEL).of(volume)
    by_noise = NORMAL * deviations.astype(np.float64)
    together = np.maximum(active.compress(pattern), by_noise)
    mismatch = _light_mismatch(system, measured, seen)
    light = math.hypot(mismatch, LIGHT * unexplained, light_error)
    truth = np.where(where, moved.truth, 0.0)
    own = [np.where(where, error, 0.0) for error in errors]
    noise = (np.where(where, moved.noise, 0.0),)
    values = summaries.split(summaries.all_of(volume, active.grid), active.grid)
    return Intervals(
        active,
        by_noise.astype(np.float32),
        np.sqrt(together**2 - by_noise**2).astype(np.float32),
        together.astype(np.float32),
        values,
        _half_widths(values, active.grid, truth, own, light),
        _half_widths(values, active.grid, truth, noise, 0.0, placed=0.0),
        growth,
    )


def _half_widths(
    values: dict[str, NDArray[np.float64]],
    grid: VoxelGrid,
    truth: NDArray[np.float64],
    errors: Sequence[NDArray[np.float64]],
    light: float,
    placed: float = PLACED,
) -> dict[str, NDArray[np.float64]]:
    """Return half-widths of total, plane sums and edges.

    ``errors`` (nx, ny, nz) are those of a volume ``truth``; ``light`` is the relative deviation of
    all sums.
    """
    sums = summaries.plane_sums(truth, grid)
    off = [summaries.plane_sums(error, grid) for error in errors]
    relative = math.sqrt(
        np.mean([_squares(one) for own in off for one in own])
        / max(np.mean([_squares(one) for one in sums]), np.finfo(float).tiny)
    )
    light_of_all = np.sqrt(np.mean([(one.sum() / truth.sum()) ** 2 for one in errors]))
    found = {"total": np.asarray(NORMAL * math.hypot(light, light_of_all) * values["total"])}
    edges = np.full((3, 2), np.nan)
    for axis, letter in enumerate("xyz"):
        name = f"plane_sums_{letter}"
        own, places = values[name], grid.axes()[axis]
        half = NORMAL * np.sqrt((light * own) ** 2 + relative**2 * _squares(own))
        found[name] = half
        if len(own) < 2:
            edges[axis] = grid.spacing[axis]
            continue
        slopes = np.abs(np.gradient(own, places))
        for side, place in enumerate(values["edges"][axis]):
            slope = max(np.interp(place, places, slopes), np.finfo(float).tiny)
            moves = min(np.interp(place, places, half) / slope, grid.extent[axis])
            edges[axis, side] = math.hypot(moves, placed * grid.spacing[axis])
    return found | {"edges": edges}


def _squares(values: NDArray[np.float64]) -> float:
    return float(np.mean(np.square(values)))


def _light_mismatch(
    system: LinearSystem, measured: NDArray[np.float32], seen: NDArray[np.float32]
) -> float:
    """Return by how much the images' light differs from their re-projections', relative.

    The mean over the views and, in squares, its standard error.
    """
    starts, stops = system.projector.view_ptr[:-1], system.projector.view_ptr[1:]
    pairs = [
        (measured[a:b].sum(dtype=np.float64), seen[a:b].sum(dtype=np.float64))
        for a, b in zip(starts, stops, strict=True)
    ]
    ratios = np.array([light / found - 1 for light, found in pairs if found > 0])
    if len(ratios) < 2:
        return 0.0
    return float(np.hypot(ratios.mean(), ratios.std(ddof=1) / len(ratios) ** 0.5))
