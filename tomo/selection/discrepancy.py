"""The discrepancy principle: fit the images as well as their noise allows, and no better.

A volume that reproduces noisy images more closely than the truth does has fitted noise. Given the
noise's standard deviation, that is all it takes to choose when to stop an iteration, or how strong
a penalty should be: ``||W^½ (b - A x)|| = ||W^½ sigma||``.

Morozov, "On the solution of functional equations by the method of regularization", Soviet
Mathematics 7 (1966).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers import Solution
from tomo.solvers.iterate import check_measured
from tomo.solvers.least_squares import check_weights
from tomo.solvers.solution import Callback


def noise_residual(
    projector: ProjectionOperator,
    measured: ArrayLike,
    noise: ArrayLike,
    weights: ArrayLike | None = None,
) -> float:
    """Return the relative residual that the noise alone explains, ``||W^½ s|| / ||W^½ b||``.

    Comparable with a history's. NaN when the images are dark.

    Parameters
    ----------
    projector : ProjectionOperator
    measured : (pixels,)
    noise : float or (pixels,)
        Standard deviation ``s`` in the images' unit, >= 0.
    weights : (pixels,), optional
        Those that the solver is given.

    Raises
    ------
    ValueError
        If the noise is negative or not finite, or not one or one a pixel.
    """
    measured = check_measured(projector, measured).astype(np.float64)
    noise = np.asarray(noise, np.float64)
    if noise.shape not in ((), measured.shape):
        raise ValueError(
            f"noise: found shape {noise.shape}, expected one number or one for each of the "
            f"projector's {len(measured)} pixels"
        )
    if not (np.isfinite(noise) & (noise >= 0)).all():
        raise ValueError("noise: found negative, NaN or infinite ones, expected >= 0")
    weights = check_weights(projector, weights)
    root = 1.0 if weights is None else np.sqrt(weights, dtype=np.float64)
    level = norm(root * np.broadcast_to(noise, measured.shape))
    scale = norm(root * measured)
    return level / scale if scale > 0 else math.nan


def stop_at_noise(level: float, callback: Callback | None = None) -> Callback:
    """Return a callback that stops when the relative residual reaches ``level``.

    Parameters
    ----------
    level : float
        Of `noise_residual`, perhaps times a factor just above 1.
    callback : callable, optional
        Called as well; it may stop too.
    """

    def at_noise(index: int, volume: Any, relative_residual: float) -> bool:
        told = callback is not None and callback(index, volume, relative_residual)
        return bool(told) or relative_residual <= level

    return at_noise


def strength_at_noise(
    method: Callable[..., Solution],
    projector: ProjectionOperator,
    measured: ArrayLike,
    noise: ArrayLike,
    *,
    first: float = 1e-2,
    runs: int = 6,
    tolerance: float = 2e-3,
    factor: float = 1.0,
    weights: ArrayLike | None = None,
    **settings: Any,
) -> Solution:
    """Solve with the strength at which the residual is that of the noise.

    The residual rises with the strength: it is bracketed by factors of eight and then searched
    for along straight lines in the logarithm of the strength. Each run starts from the last. With
    many more pixels than voxels the residual hardly depends on the strength, and what the voxels
    cannot represent counts as noise as well: views left out then choose better
    (`tomo.selection.choose`). Where less strength no longer fits better the search ends with the
    stronger.

    Parameters
    ----------
    method : callable
        `tomo.solvers.tv` or `tomo.solvers.tikhonov`.
    projector, measured, weights
        Of the method.
    noise : float or (pixels,)
        Standard deviation, see `noise_residual`.
    first : float
        The strength tried first.
    runs : int
        At most so many runs of the method.
    tolerance : float
        Relative, on the residual. That of 100,000 noisy pixels is itself known to 2e-3.
    factor : float
        On the noise's residual; above 1 where the model errs as well.
    **settings
        Further arguments of the method.

    Returns
    -------
    Solution
        Its ``settings["strength"]`` is what was found.

    Raises
    ------
    ValueError
        If ``first``, ``runs`` or the noise is out of range.
    """
    if not (0 < first < math.inf and runs >= 1):
        raise ValueError(f"first, runs: found {first}, {runs}, expected a strength > 0, runs >= 1")
    level = factor * noise_residual(projector, measured, noise, weights)
    below: tuple[float, float] | None = None  # log strength, log of residual over level
    above: tuple[float, float] | None = None
    place, found = math.log(first), None
    for _ in range(runs):
        start = settings.pop("start", None) if found is None else found.volume
        before, found = (
            found,
            method(
                projector,
                measured,
                strength=math.exp(place),
                start=start,
                weights=weights,
                **settings,
            ),
        )
        residual = found.relative_residual
        if not (level > 0 and residual > 0) or abs(residual / level - 1) <= tolerance:
            break
        off = math.log(residual / level)
        if above is not None and below is None and off > above[1] - tolerance:
            return before
        below, above = (below, (place, off)) if off > 0 else ((place, off), above)
        if below is None or above is None:
            place += math.log(8) * (-1 if off > 0 else 1)
        else:
            share = below[1] / (below[1] - above[1])
            place = below[0] + min(max(share, 0.1), 0.9) * (above[0] - below[0])
    return found
