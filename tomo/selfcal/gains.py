"""What the cameras' sensitivities and backgrounds are: ``b_v = g_v (A x)_v + o_v``.

All views of transparent gas see the same total light, whatever its shape: rays that fill a view
integrate all of the volume. So the ratio of a view's total to what a first, crude volume predicts
of it is the view's gain, to a tenth of a per cent, although that volume was made from the wrong
gains; pixel by pixel, in contrast, a volume from few views reproduces every image, gains and all.
Where the volume is dark the pixels show the offset alone.

A common factor of all gains is one of the volume: their geometric mean is 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.operators import GaussianBasis
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import check_measured
from tomo.operators.view_gains import Gains, geometric_mean
from tomo.solvers import Solution, cgls, mlem
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.subsets import interleaved

DARK = 0.03
"""Pixels are dark whose predicted light is below this share of the view's brightest."""

FEWEST_DARK = 50
"""An offset is fitted only where so many pixels are dark."""

FAINTEST = 0.01
"""A view with less than this share of the median view's light says nothing of its gain."""

STRANGEST = 10.0
"""Gains beyond this factor of the median are those of views that see something else."""

MODEL_ERROR = 0.002
"""Relative error of a view's total from voxels and cameras; bounds the gain's error below."""

BLOCKS = 24
"""Parts of a view whose residuals count as independent."""

NEGATIVE = 0.01
"""Share of all light in negative pixels above which noise is not to be clipped away."""

ROUNDS = 2
ITERATIONS = 6
WIDTH = 1.0
CROSSINGS = 1_000_000
"""Of an estimate without a volume: its rounds, the iterations of each, the width of the blobs, and
the size that large systems are thinned to while a volume is made; all pixels are compared."""


def fit_gains(
    projector: ProjectionOperator, measured: ArrayLike, volume: ArrayLike, *, offsets: bool = True
) -> Gains:
    """Fit every view's gain and offset to what a volume predicts of it.

    The offset is the median of the dark pixels, the gain the ratio of the totals. Its standard
    error comes from the residuals, summed over stretches of pixels so that neighbours may err
    together, and is no less than `MODEL_ERROR`.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
    volume : (unknowns,) or of the grid
    offsets : bool
        Whether to fit offsets; zero if not.

    Raises
    ------
    ValueError
        If the pixels or voxels do not fit the projector, or are not finite.
    """
    measured = check_measured(projector, measured).astype(np.float64)
    flat = np.asarray(volume).ravel()
    if flat.size == projector.grid.size:
        flat = projector.active.compress(flat)
    if flat.size != projector.shape[1] or not np.isfinite(flat).all():
        raise ValueError(
            f"volume: found {flat.size} values, expected {projector.shape[1]} finite ones"
        )
    predicted = np.asarray(projector @ flat, np.float64)
    n_views = projector.n_views
    gain, offset = np.ones(n_views), np.zeros(n_views)
    gain_error, offset_error = np.full(n_views, np.inf), np.full(n_views, np.inf)
    for number in range(n_views):
        view = slice(*projector.view_ptr[number : number + 2])
        seen, expected = measured[view], predicted[view]
        if offsets:
            offset[number], offset_error[number] = _offset(seen, expected)
        total = expected.sum()
        if total > 0:
            gain[number] = (seen - offset[number]).sum() / total
            residual = seen - offset[number] - gain[number] * expected
            gain_error[number] = _error_of_sum(residual) / total
    light = np.add.reduceat(np.append(predicted, 0.0), projector.view_ptr[:-1])
    light[np.diff(projector.view_ptr) == 0] = 0
    typical = float(np.median(light[light > 0])) if (light > 0).any() else 0.0
    lit = np.isfinite(gain_error) & (gain > 0) & (light > FAINTEST * typical)
    middle = float(np.median(gain[lit])) if lit.any() else 1.0
    lit &= (gain < STRANGEST * middle) & (gain > middle / STRANGEST)
    mean = geometric_mean(gain[lit])
    return Gains(
        np.where(lit, gain / mean, 1.0),
        offset,
        np.where(lit, np.hypot(gain_error, MODEL_ERROR * gain) / mean, np.inf),
        offset_error,
        float(measured.max(initial=0.0)) or 1.0,
    )


def estimate_gains(
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    offsets: bool = True,
    rounds: int = ROUNDS,
) -> Gains:
    """Return gains and offsets from the images alone, by a few quick iterations.

    Of MLEM; where noise makes many pixels negative, of CGLS on a smooth basis and free to go
    below zero itself: noise then adds no light.

    Whether they are worth correcting is `Gains.views_disagree`. Volumes of large systems are made
    from evenly thinned pixels.
    With fewer than two views there is nothing to compare: gains of 1.
    """
    measured = check_measured(projector, measured)
    if np.count_nonzero(np.diff(projector.view_ptr)) < 2 or not measured.any():
        return Gains.none(projector.n_views)
    stride = max(int(min(projector.n_segments // CROSSINGS, projector.shape[0] // 1000)), 1)
    some = interleaved(projector.shape[0], stride)[0]
    thinned = projector.take(some).packed() if stride > 1 else projector

    light = float(np.abs(measured).sum(dtype=np.float64))
    darkness = -float(np.minimum(measured, 0).sum(dtype=np.float64)) / light

    def quick(pixels: NDArray[np.float32]) -> Solution:
        pixels = pixels[some]
        if darkness < NEGATIVE:
            return mlem(thinned, pixels, iterations=ITERATIONS, start=mlos_start(thinned, pixels))
        basis = GaussianBasis(thinned, WIDTH)
        found = cgls(basis, pixels, iterations=ITERATIONS, nonnegative=False)
        return replace(found, volume=basis.volume(found.volume))

    return solve_with_gains(quick, projector, measured, rounds=rounds, offsets=offsets)[1]


def gains_worth_correcting(
    projector: ProjectionOperator, measured: ArrayLike, wanted: bool | None = None
) -> Gains | None:
    """Return the gains to correct the images by, None if none.

    Parameters
    ----------
    projector, measured
        See `fit_gains`.
    wanted : bool, optional
        Whether to correct them; only when the views disagree if None.

    Notes
    -----
    Whether views disagree is judged by gains alone. An offset common to all views is told from
    faint haze by dark pixels only, and where noise hides the haze those pixels are not quite dark.
    One round tells: a second moves gains by a fiftieth of what they scatter.
    """
    if wanted is False:
        return None
    if wanted is None:
        first = estimate_gains(projector, measured, offsets=False, rounds=1)
        if not first.views_disagree:
            return None
    return estimate_gains(projector, measured)


def solve_with_gains(
    solver: Callable[[NDArray[np.float32]], Solution],
    projector: ProjectionOperator,
    measured: ArrayLike,
    *,
    rounds: int = ROUNDS,
    offsets: bool = True,
) -> tuple[Solution, Gains]:
    """Solve for volume and gains in turn: ``rounds`` times solve, fit and correct the images.

    Parameters
    ----------
    solver : callable
        ``solver(measured)`` returns the volume of images ``(pixels,)`` corrected so far.
    projector, measured, offsets
        See `fit_gains`.
    rounds : int
        At least 1. The volume returned is that before the last fit; two rounds leave an error
        of a tenth of a per cent.

    Raises
    ------
    ValueError
        If ``rounds`` is below 1.
    """
    if rounds < 1:
        raise ValueError(f"rounds: found {rounds}, expected at least 1")
    measured = check_measured(projector, measured)
    gains = Gains.none(projector.n_views)
    for _ in range(rounds):
        corrected = gains.correct(projector, measured)
        found = solver(corrected)
        gains = gains.then(fit_gains(projector, corrected, found.volume, offsets=offsets))
    return found, gains


def _offset(seen: NDArray[np.float64], expected: NDArray[np.float64]) -> tuple[float, float]:
    """Return the median of the pixels where no light is expected, and its standard error."""
    dark = seen[np.abs(expected) <= DARK * expected.max(initial=0.0)]
    if len(dark) < FEWEST_DARK:
        return 0.0, np.inf
    middle = float(np.median(dark))
    spread = 1.4826 * float(np.median(np.abs(dark - middle)))
    return middle, 1.2533 * spread / np.sqrt(len(dark)) + np.finfo(np.float64).tiny


def _error_of_sum(residual: NDArray[np.float64]) -> float:
    """Return the standard error of the sum of residuals that correlate over short stretches."""
    parts = [part.sum() for part in np.array_split(residual, min(BLOCKS, len(residual)))]
    return float(np.sqrt(np.sum(np.square(parts))))
