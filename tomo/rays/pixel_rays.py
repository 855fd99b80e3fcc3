"""The rays of one pixel: where they pass through its area, and through the lens' aperture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.aperture import disc_rule

FEWEST_POINTS = 2
"""Points of the aperture for each position in a pixel: one alone looks from beside the lens'
middle, and shifts the position's share of the image."""


def positions_in_pixel(supersample: int) -> NDArray[np.float64]:
    """Return the positions of a pixel's rays, down and right of its centre, ``(K², 2)``."""
    steps = steps_in_pixel(supersample)
    return np.stack([np.repeat(steps, supersample), np.tile(steps, supersample)], axis=1)


def steps_in_pixel(supersample: int) -> NDArray[np.float64]:
    """Return the positions of a pixel's rays along one side, from its centre, ``(K,)``."""
    return (np.arange(supersample) + 0.5) / supersample - 0.5


def points_of_aperture(
    supersample: int, aperture_rays: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of the pupil that each position in a pixel looks from.

    Parameters
    ----------
    supersample : int
        K, positions along each side of a pixel.
    aperture_rays : int
        Rays of a pixel in all, dealt to its positions; 1: all look from the pupil's centre.

    Returns
    -------
    points : (K², M, 2) float64
        In the unit disc, right and down. Each position has the rule of `rigs.aperture.disc_rule`,
        turned from position to position: together they are a finer one.
    weights : (M,) float64
        Their sum is one.
    """
    several = supersample**2
    if aperture_rays == 1:
        return np.zeros((several, 1, 2)), np.ones(1)
    count = rays_of_pixel(supersample, aperture_rays) // several
    rules = [disc_rule(count, number / several) for number in range(several)]
    return np.stack([points for points, _ in rules]), rules[0][1]


def rays_of_pixel(supersample: int, aperture_rays: int = 1) -> int:
    """Return how many rays a pixel has.

    Raises
    ------
    ValueError
        If either number is no whole number from one on.
    """
    for name, value in (("supersample", supersample), ("aperture_rays", aperture_rays)):
        if not (value >= 1 and value % 1 == 0):
            raise ValueError(f"{name}: found {value}, expected a whole number >= 1")
    several = int(supersample) ** 2
    if aperture_rays == 1:
        return several
    return several * max(-(-int(aperture_rays) // several), FEWEST_POINTS)
