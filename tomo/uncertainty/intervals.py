"""90 % intervals of voxels, total, plane sums and edges: noise and structure, together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.operators.system import Progress
from tomo.uncertainty import summaries
from tomo.uncertainty.bootstrap import Deviations, bootstrap_images
from tomo.uncertainty.jackknife import Jackknife, Resolve, jackknife

LEVEL = 0.9
NORMAL = 1.645
"""Half-width of the normal distribution's interval of `LEVEL`, in standard deviations."""

NEIGHBOURS = 1.0
"""Standard deviation, in voxels, of the blur over squared changes: those of single voxels cross
zero where errors do not. Less leaves such zeros, more smears the errors of edges over flat gas."""

WEIGHTS = {"without cameras": 0.5, "second pass": 0.25, "unexplained": 0.25}
"""Exponents of the three measures of structure, whose sum is 1; see `structure_measures`."""

SCALE = 2.8
"""Half-width of the voxels' interval over the weighted geometric mean of the measures."""

SMALLEST = 1e-4
"""Fraction of the emission's root mean square to which measures are raised before logarithms."""

FITTED = 0.8
"""Fraction of the noise's square that the residual still has. With less, noise is unexplained."""

EXPLAINED = 0.003
"""Relative residual below which images are explained: voxels themselves leave as much."""

FACTOR = 2.0
"""Half-width over the root of the summed squares, for totals, plane sums and edges."""

LIGHT = 0.15
"""Fraction of the unexplained part of the images that may be light that total and plane sums lack,
or have too much. Less misses light from outside the grid, more widens all others."""

PLANES = 1.5
"""Standard deviation, in planes, of the blur over the squared half-widths of plane sums."""

PLACED = 0.1
"""Half-width, in voxels, that no edge goes below: that of a place within a voxel."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Half-widths of 90 % intervals; together is at least the noise alone.

    Attributes
    ----------
    active : ActiveVoxels
        The unknowns, of the voxels' arrays.
    noise, structure, together : (unknowns,) float32
        ``together² = noise² + structure²``, in the volume's unit.
    values : mapping of str to array
        ``total`` (), ``plane_sums_x`` (nx,), ``..._y``, ``..._z`` and ``edges`` (3, 2).
    half_widths, noise_of_values : mapping of str to array
        The same for ``values``, together and by noise.
    groups : int
        Groups of cameras that were left out in turn.
    """

    active: ActiveVoxels
    noise: NDArray[np.float32]
    structure: NDArray[np.float32]
    together: NDArray[np.float32]
    values: Mapping[str, NDArray[np.float64]]
    half_widths: Mapping[str, NDArray[np.float64]]
    noise_of_values: Mapping[str, NDArray[np.float64]]
    groups: int

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
            "camera_groups": self.groups,
            "voxels": {
                "median_half_width": float(np.median(spread)) if len(spread) else math.nan,
                "relative": relative(self.together),
                "relative_noise": relative(self.noise),
                "relative_structure": relative(self.structure),
            },
        }
        for name, value in self.values.items():
            found[name] = {
                "value": value.tolist(),
                "half_width": self.half_widths[name].tolist(),
                "noise": self.noise_of_values[name].tolist(),
            }
        return found


def intervals(
    system: LinearSystem,
    measured: NDArray[np.float32],
    volume: NDArray[np.float32],
    emitting: NDArray[np.bool_],
    deviations: Deviations,
    solve: Resolve,
    progress: Progress | None = None,
) -> Intervals | None:
    """Return the intervals of a volume; None where no camera can be left out, or nothing emits.

    Parameters
    ----------
    system : LinearSystem
    measured : (pixels,) float32
    volume : (unknowns,) float32
    emitting : (unknowns,) bool
    deviations : Deviations
        By noise.
    solve : callable
        The reconstruction, from all views or some.
    progress : callable, optional

    Notes
    -----
    A voxel's half-width is `SCALE` times the weighted geometric mean of three measures, with the
    exponents `WEIGHTS`, and at least the interval by noise; see `structure_measures`. Exponents
    and scale are settled on known scenes, so that 90 % of the emitting voxels' true values are
    inside. The measures' scale is the scene's own: twice the light, twice the intervals.

    A quantity of the whole volume has `FACTOR` times the root of the summed squares of: deviation
    by noise, jackknife deviation, change by a second pass, and for total and plane sums the
    relative difference between the images' light and that of their re-projections, and `LIGHT`
    times their unexplained part.
    """
    if not emitting.any():
        return None
    left_out = jackknife(system, measured, solve, progress)
    if left_out is None:
        return None
    seen = (system.projector @ volume).astype(np.float32)
    again = solve(bootstrap_images(system, measured, seen))
    apart = _unexplained(measured, seen, deviations.noise)
    measures = structure_measures(system, volume, emitting, left_out, again, apart)
    by_noise = NORMAL * deviations.values.astype(np.float64)
    logs = sum(weight * np.log(measures[name]) for name, weight in WEIGHTS.items())
    together = np.maximum(SCALE * np.exp(logs), by_noise)
    structure = np.sqrt(together**2 - by_noise**2)
    light = math.hypot(_light_mismatch(system, measured, seen), LIGHT * apart)
    of_values = _of_summaries(system, volume, left_out, again, deviations, light)
    return Intervals(
        system.projector.active,
        by_noise.astype(np.float32),
        structure.astype(np.float32),
        together.astype(np.float32),
        *of_values,
        len(left_out.groups),
    )


def structure_measures(
    system: LinearSystem,
    volume: NDArray[np.float32],
    emitting: NDArray[np.bool_],
    left_out: Jackknife,
    again: NDArray[np.float32],
    unexplained: float,
) -> dict[str, NDArray[np.float64]]:
    """Return three measures of what is wrong with a voxel, in the volume's unit, (unknowns,) each.

    ``without cameras``
        The jackknife's deviation: missing views, and cameras that disagree.
    ``second pass``
        The change when the re-projected images are solved in turn: smoothing and bounds.
    ``unexplained``
        The unexplained fraction of the images, of the root mean square of the emission.

    The first two are root mean squares over neighbours.
    """
    active = system.projector.active
    size = float(np.sqrt(np.mean(np.square(volume[emitting], dtype=np.float64))))
    found = {
        "without cameras": left_out.deviation(volume, left_out.volumes),
        "second pass": np.subtract(again, volume, dtype=np.float64),
    }
    found = {name: _over_neighbours(values, active) for name, values in found.items()}
    found["unexplained"] = np.full(len(volume), unexplained * size)
    return {name: np.maximum(values, SMALLEST * size) for name, values in found.items()}


def _over_neighbours(values: NDArray[np.float64], active: ActiveVoxels) -> NDArray[np.float64]:
    """Return the root mean square over a voxel's neighbours; what is not active is zero."""
    from scipy.ndimage import gaussian_filter

    squares = active.expand(np.square(values)).reshape(active.grid.shape)
    return np.sqrt(active.compress(gaussian_filter(squares, NEIGHBOURS, mode="constant")))


def _unexplained(
    measured: NDArray[np.float32], seen: NDArray[np.float32], noise: NDArray[np.float64]
) -> float:
    """Return the fraction of the images, a root mean square, that is not explained by noise."""
    size = norm(measured)
    left = norm(measured - seen) ** 2 - FITTED * norm(noise) ** 2
    return max(math.sqrt(max(left, 0.0)) / size, EXPLAINED)


def _of_summaries(
    system: LinearSystem,
    volume: NDArray[np.float32],
    left_out: Jackknife,
    again: NDArray[np.float32],
    deviations: Deviations,
    light: float,
) -> tuple[dict[str, NDArray], dict[str, NDArray], dict[str, NDArray]]:
    """Return values, half-widths and half-widths by noise of totals, plane sums and edges.

    ``light`` is the relative deviation that light gives sums.
    """
    active = system.projector.active
    grid = active.grid
    whole, second, *parts = (
        summaries.of_unknowns(one, active) for one in (volume, again, *left_out.volumes)
    )
    by_noise = np.std(deviations.summaries, axis=0, ddof=1)
    squares = by_noise**2 + left_out.deviation(whole, np.stack(parts)) ** 2
    squares = summaries.split(squares + (second - whole) ** 2, grid)
    values, noise = summaries.split(whole, grid), summaries.split(by_noise, grid)
    half_widths = {}
    for name, square in squares.items():
        if name == "edges":
            own = (PLACED * np.asarray(grid.spacing)[:, None]) ** 2 / FACTOR**2
            half_widths[name] = FACTOR * np.sqrt(square + own)
        else:
            square = _over_planes(square + (light * values[name]) ** 2)
            half_widths[name] = FACTOR * np.sqrt(square)
    return values, half_widths, {name: NORMAL * one for name, one in noise.items()}


def _over_planes(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means of neighbouring planes; a total stays."""
    from scipy.ndimage import gaussian_filter1d

    return gaussian_filter1d(squares, PLANES, mode="nearest") if squares.ndim else squares


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
