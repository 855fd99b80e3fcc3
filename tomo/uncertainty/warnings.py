"""Warnings that a volume is not to be trusted: what was found, what it means, what to do."""

from __future__ import annotations

import math

import numpy as np

from rigs.check.words import direction_words
from tomo.uncertainty.angular_coverage import AngularCoverage

BARELY_SEEN = 0.05
"""Largest fraction of the emitting voxels that fewer than two views may see."""

UNEXPLAINED = 1 / 3
"""Largest fraction of the images that neither volume nor noise explains."""

ABOVE_NOISE = 2.0
"""Ratio of residual to noise up to which the residual may be noise."""

NOISY = 0.5
"""Largest root mean square standard deviation, as a fraction of that of the emission."""


def trust_warnings(
    seen: AngularCoverage, residual: float, noise: float, deviation: float = math.nan
) -> tuple[str, ...]:
    """Return the reasons not to trust a volume, one line each.

    Parameters
    ----------
    seen : AngularCoverage
    residual, noise : float
        Relative to the images; NaN where unknown.
    deviation : float
        Root mean square standard deviation over that of the emission; NaN where unknown.
    """
    lines = []
    if seen.resolved is not None and seen.resolved.is_coarse:
        direction = direction_words(seen.resolved.worst_direction)
        lines.append(
            f"few directions: {seen.words}, as large as the emission itself: shapes along "
            f"{direction} are a guess. Add a camera that looks across {direction}"
        )
    barely = float(np.mean(seen.views[seen.emitting] < 2)) if seen.emitting.any() else 0.0
    if barely > BARELY_SEEN and seen.median_views > 2:
        lines.append(
            f"partly unseen: fewer than two views see {barely:.0%} of the emitting voxels. "
            "Do not trust their values, or move the grid"
        )
    unexplained = math.sqrt(max(residual**2 - noise**2, 0.0)) if noise >= 0 else residual
    if unexplained > UNEXPLAINED and not residual <= ABOVE_NOISE * noise:
        lines.append(
            f"unexplained images: the projections miss them by {residual:.0%}"
            + (f", the noise is {noise:.1%}" if noise >= 0 else "")
            + ". Cameras, gains or optics differ from the rig, or the voxels are too coarse: run "
            "check-rig, refine the cameras, or use smaller voxels"
        )
    if deviation > NOISY:
        lines.append(
            f"noise: the voxels' standard deviation is {deviation:.0%} of the emission. Average "
            "over regions or frames, or use fewer voxels"
        )
    return tuple(lines)
