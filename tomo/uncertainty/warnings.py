"""When an answer is not to be trusted, and why: plain lines."""

from __future__ import annotations

import math

import numpy as np

from tomo.uncertainty.angular_coverage import Seeing

FEW_LINES = 4
"""Fewer lines through the typical emitting voxel hardly say where along them light is. Clean
images of three that are spread evenly leave an NRMSE of 0.33 (jet) and 0.44 (turbulent flame), of
four 0.06 and 0.25. The gap does not tell: that of eleven views within 110 degrees is wider."""

WIDE_GAP = 75.0
"""Degrees; two views at right angles leave 90, three evenly spread ones 60."""

BARELY_SEEN = 0.05
"""The largest share of the emitting voxels that fewer than two views may see."""

UNEXPLAINED = 1 / 3
"""The largest share of the images that neither volume nor noise may explain."""

ABOVE_NOISE = 2.0
"""Residual over noise from which on what is unexplained is no matter of the noise."""

NOISY = 0.5
"""The largest standard deviation, as a share of the emission, root mean squares of both."""


def doubts(
    seen: Seeing, residual: float, noise: float, deviation: float = math.nan
) -> tuple[str, ...]:
    """Return why a volume is not to be trusted, one line each; none where nothing speaks for it.

    Parameters
    ----------
    seen : Seeing
    residual, noise : float
        Of the images, relative to them; NaN where not known.
    deviation : float
        Root mean square standard deviation over that of the emission; NaN where not known.
    """
    lines = []
    if seen.median_lines < FEW_LINES:
        found, what = f"{seen.median_views:g}", "what lies along their lines of sight is guessed"
        if seen.median_lines < seen.median_views:
            ending = "" if seen.median_lines == 1 else "s"
            found += f", along {seen.median_lines:g} line{ending} of sight"
            what = "opposite views, or neighbours, share one; what lies along it is guessed"
        lines.append(
            f"few views: the typical voxel that emits is seen by {found}, expected {FEW_LINES} or "
            f"more: {what}"
        )
    if seen.median_gap > WIDE_GAP:
        lines.append(
            f"wide gap: the views leave {seen.median_gap:.0f} degrees open, expected "
            f"{WIDE_GAP:.0f} or less: shapes are drawn out along the views that there are"
        )
    barely = float(np.mean(seen.views[seen.emitting] < 2)) if seen.emitting.any() else 0.0
    if barely > BARELY_SEEN and seen.median_views > 2:
        lines.append(
            f"partly unseen: {barely:.0%} of the voxels that emit are seen by fewer than two views"
        )
    unexplained = math.sqrt(max(residual**2 - noise**2, 0.0)) if noise >= 0 else residual
    if unexplained > UNEXPLAINED and not residual <= ABOVE_NOISE * noise:
        lines.append(
            f"unexplained images: they are missed by {residual:.0%}"
            + (f", of which noise explains {noise:.1%}" if noise >= 0 else "")
            + ": cameras, gains or optics are not as the rig says, or the voxels are too coarse"
        )
    if deviation > NOISY:
        lines.append(
            f"noise: the voxels' standard deviation is {deviation:.0%} of the emission: average "
            "over regions or moments, or use fewer voxels"
        )
    return tuple(lines)
