"""Per-view gains and offsets, estimated from the images: ``b_v = g_v (A x)_v + o_v``.

All views of a transparent gas record the same total light, whatever its shape, because the pixels
that fill a view integrate the whole volume. The ratio of a view's total to that of a first, crude
volume is therefore the view's gain, although that volume was solved for with wrong gains. The
volume's total is that of its light at the view's pixels (`tomo.selfcal.total_light`), not of its
rays: rays through the middles of pixels meet some voxels more than others, and a volume with its
light at those reproduces wrong gains. Single pixels cannot show the gain for the same reason.
Pixels where the volume is dark show the offset alone.

The worst of 4 to 24 cameras is off by so many per cent, in the median of seven scenes and in the
worst one (`docs/results/gains.md`):

=============================  ===========  ============  ============  ============
pixels' width in voxels        no noise     0.5 % noise   3 % noise     10 % noise
=============================  ===========  ============  ============  ============
0.45 to 1                      0.03, 0.09   0.6, 2.5      2.0, 6.5      5.4, 21
0.9 to 2                       0.06, 0.27   0.7, 4.5      3.5, 14       12, over 100
1.8 to 4                       0.55, 5.2    1.1, 1.8      5.4, 33       22, 44
=============================  ===========  ============  ============  ============

Noise is in units of the brightest pixel, and limits the gain by the background: a total has
thousands of dark pixels. The worst scenes have a camera that sees a part of the volume, or a few
sparks in the dark. Standard errors come with the gains.

A factor common to all gains is a factor of the volume, so the geometric mean of the gains is 1:
that of the calibrated cameras where only some have an absolute scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.operators import GaussianBasis, LinearSystem
from tomo.operators.vectors import check_measured
from tomo.operators.view_gains import Gains, geometric_mean
from tomo.selfcal.total_light import ViewLight, view_sums
from tomo.solvers.cgls import cgls
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem
from tomo.solvers.solution import Solution
from tomo.solvers.subsets import interleaved

DARK = 0.03
"""Fraction of the view's brightest predicted pixel below which a pixel counts as dark. Higher,
faint light enters the offset; lower, few pixels are left to measure it."""

FEWEST_DARK = 50
"""Dark pixels that a fit of an offset needs at least. Fewer give an offset made of noise; asking
for more leaves the offsets of small images at zero."""

LEAST_LIGHT = 0.01
"""Fraction of the median view's light below which a view's gain is not fitted. Lower, noise sets
the gain; higher, views of a small part of the flame keep a gain of 1."""

LARGEST_RATIO = 10.0
"""Factor from the median beyond which a gain is not accepted: the view shows another scene.
Lower, very unlike cameras keep a gain of 1; higher, a wrong view distorts the mean gain."""

MODEL_ERROR = 0.002
"""Least relative standard error of a gain, from voxel size and camera errors. Lower, equal cameras
are reported as unequal; higher, small differences are missed."""

BLOCKS = 24
"""Stretches of a view's pixels whose residuals count as independent. More, correlated residuals
make the error too small; fewer, the error itself is uncertain."""

NEGATIVE_FRACTION = 0.01
"""Fraction of all light in negative pixels above which the volume may be negative. Higher, clipped
noise adds light; lower, clean images lose the positivity that steadies the volume."""

ROUNDS = 2
"""Outer iterations of an estimate. One leaves a larger error; a third costs time for nothing."""

ITERATIONS = 6
"""Iterations of each quick volume: fewer leave it too smooth, more fit the wrong gains."""

WIDTH = 1.0
"""Width of the Gaussian blobs in voxels where noise makes many pixels negative."""

SEGMENTS = 1_000_000
"""Segments that large systems are thinned to for the quick volume. More take longer, fewer make
the volume coarse; all pixels are compared in any case."""


def fit_gains(
    system: LinearSystem,
    measured: ArrayLike,
    volume: ArrayLike,
    *,
    offsets: bool = True,
    light: ViewLight | None = None,
) -> Gains:
    """Fit the gain and the offset of every view to the prediction from a volume.

    The offset is the median of the dark pixels. The gain is the ratio of the totals, measured
    over predicted. Its standard error comes from residuals summed over stretches of pixels, which
    allows for correlated neighbours, and is at least `MODEL_ERROR`.

    Parameters
    ----------
    system : LinearSystem
    measured : (pixels,)
    volume : (unknowns,) or (nx, ny, nz)
    offsets : bool
        Whether to fit offsets. They are zero otherwise.
    light : ViewLight, optional
        That of the system, where it is known already, or where gas absorbs.

    Returns
    -------
    Gains
        A gain that the images do not determine is 1 and its standard error infinite.

    Raises
    ------
    ValueError
        If the pixels or voxels do not fit the projector, or are not finite.
    """
    projector = system.projector
    measured = check_measured(projector, measured).astype(np.float64)
    flat = np.asarray(volume).ravel()
    if flat.size == projector.grid.size:
        flat = projector.active.compress(flat)
    if flat.size != projector.shape[1] or not np.isfinite(flat).all():
        raise ValueError(
            f"volume: found {flat.size} values, expected {projector.shape[1]} finite ones"
        )
    predicted = np.asarray(projector @ flat, np.float64)
    light = ViewLight.of(system) if light is None else light
    totals, sampled = light.totals(projector, flat, predicted), view_sums(projector, predicted)
    n_views = projector.n_views
    gain, offset = np.ones(n_views), np.zeros(n_views)
    gain_error, offset_error = np.full(n_views, np.inf), np.full(n_views, np.inf)
    for number in range(n_views):
        view = slice(*projector.view_ptr[number : number + 2])
        recorded, expected = measured[view], predicted[view]
        if offsets:
            offset[number], offset_error[number] = _offset(recorded, expected)
        if totals[number] > 0 and sampled[number] > 0:
            lit = recorded - offset[number]
            gain[number] = lit.sum() / totals[number]
            residual = lit - lit.sum() / sampled[number] * expected
            gain_error[number] = _error_of_sum(residual) / totals[number]
    typical = float(np.median(totals[totals > 0])) if (totals > 0).any() else 0.0
    determined = np.isfinite(gain_error) & (gain > 0) & (totals > LEAST_LIGHT * typical)
    median = float(np.median(gain[determined])) if determined.any() else 1.0
    determined &= (gain < LARGEST_RATIO * median) & (gain > median / LARGEST_RATIO)
    mean = geometric_mean(gain[determined])
    return Gains(
        np.where(determined, gain / mean, 1.0),
        offset,
        np.where(determined, np.hypot(gain_error, MODEL_ERROR * gain) / mean, np.inf),
        offset_error,
        float(measured.max(initial=0.0)) or 1.0,
    )


def estimate_gains(
    system: LinearSystem,
    measured: ArrayLike,
    *,
    offsets: bool = True,
    rounds: int = ROUNDS,
    reference: ArrayLike | None = None,
    light: ViewLight | None = None,
) -> Gains:
    """Estimate gains and offsets from the images alone, with a few iterations of a solver.

    The solver is MLEM. Where noise makes many pixels negative it is CGLS on a smooth basis without
    the constraint of positivity, because clipped noise would add light. Large systems are thinned
    evenly before they are solved.

    Parameters
    ----------
    system, measured, offsets, light
        See `fit_gains`.
    rounds, reference
        See `solve_with_gains`.

    Returns
    -------
    Gains
        `Gains.views_disagree` says whether correcting is worthwhile. All gains are 1 with fewer
        than two views or with dark images, where nothing can be compared.
    """
    projector = system.projector
    measured = check_measured(projector, measured)
    if len(projector.views_with_pixels) < 2 or not measured.any():
        return Gains.none(projector.n_views, reference)
    stride = max(int(min(projector.n_segments // SEGMENTS, projector.shape[0] // 1000)), 1)
    kept = interleaved(projector.shape[0], stride)[0]
    thinned = projector.take(kept).packed() if stride > 1 else projector

    total = float(np.abs(measured).sum(dtype=np.float64))
    negative = -float(np.minimum(measured, 0).sum(dtype=np.float64)) / total

    def quick_solution(pixels: NDArray[np.float32]) -> Solution:
        pixels = pixels[kept]
        if negative < NEGATIVE_FRACTION:
            return mlem(thinned, pixels, iterations=ITERATIONS, start=mlos_start(thinned, pixels))
        basis = GaussianBasis(thinned, WIDTH)
        found = cgls(basis, pixels, iterations=ITERATIONS, nonnegative=False)
        return replace(found, volume=basis.volume(found.volume))

    return solve_with_gains(
        quick_solution,
        system,
        measured,
        rounds=rounds,
        offsets=offsets,
        reference=reference,
        light=light,
    )[1]


def solve_with_gains(
    solver: Callable[[NDArray[np.float32]], Solution],
    system: LinearSystem,
    measured: ArrayLike,
    *,
    rounds: int = ROUNDS,
    offsets: bool = True,
    reference: ArrayLike | None = None,
    light: ViewLight | None = None,
) -> tuple[Solution, Gains]:
    """Solve for volume and gains by alternating minimisation.

    Each of ``rounds`` outer iterations corrects the images, solves for the volume and fits the
    gains to it.

    Parameters
    ----------
    solver : callable
        ``solver(measured)`` returns the `Solution` of the corrected images ``(pixels,)``.
    system, measured, offsets, light
        See `fit_gains`.
    rounds : int
        Outer iterations, at least 1.
    reference : (views,) bool, optional
        The views whose gains have the mean 1; all when None.

    Returns
    -------
    solution : Solution
        The volume before the last fit of the gains.
    gains : Gains

    Raises
    ------
    ValueError
        If ``rounds`` is below 1.
    """
    if rounds < 1:
        raise ValueError(f"rounds: found {rounds}, expected at least 1")
    projector = system.projector
    measured = check_measured(projector, measured)
    gains = Gains.none(projector.n_views, reference)
    light = ViewLight.of(system) if light is None else light
    for _ in range(rounds):
        corrected = gains.correct(projector, measured)
        found = solver(corrected)
        fitted = fit_gains(system, corrected, found.volume, offsets=offsets, light=light)
        gains = gains.then(fitted)
    return found, gains


def _offset(recorded: NDArray[np.float64], expected: NDArray[np.float64]) -> tuple[float, float]:
    """Return the median of the pixels where no light is expected, and its standard error."""
    dark = recorded[np.abs(expected) <= DARK * expected.max(initial=0.0)]
    if len(dark) < FEWEST_DARK:
        return 0.0, np.inf
    median = float(np.median(dark))
    spread = 1.4826 * float(np.median(np.abs(dark - median)))
    return median, 1.2533 * spread / np.sqrt(len(dark)) + np.finfo(np.float64).tiny


def _error_of_sum(residual: NDArray[np.float64]) -> float:
    """Return the standard error of the sum of residuals that correlate over short stretches."""
    parts = [part.sum() for part in np.array_split(residual, min(BLOCKS, len(residual)))]
    return float(np.sqrt(np.sum(np.square(parts))))
