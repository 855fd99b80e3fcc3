"""The motion that carries points onto others best, in the least-squares sense."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

POORLY_MET = 0.05
"""Misfit, relative to the RMS distance of given points from their middle, that is worth a word."""

_ON_A_LINE = 1e-6  # second spread over the first, below which points fix no turn about their line


def motion_between(
    points: NDArray[np.float64], onto: NDArray[np.float64], rescale: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return R ``(3, 3)``, t ``(3,)`` and s of ``onto = s R points + t``, best in least squares.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns"
    (1991); s is 1 without ``rescale``, and R is never mirrored.

    Parameters
    ----------
    points, onto : (N, 3) float64
        Not on a line, else R is one of many.
    rescale : bool
        Whether lengths may grow or shrink.
    """
    middle, there = points.mean(axis=0), onto.mean(axis=0)
    left, values, right = np.linalg.svd((onto - there).T @ (points - middle))
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    R = left @ (sign[:, None] * right)
    size = float((values * sign).sum() / ((points - middle) ** 2).sum()) if rescale else 1.0
    return R, there - size * R @ middle, size


def are_on_a_line(points: NDArray[np.float64]) -> bool:
    """Return whether points ``(N, 3)`` lie on a line, as two always do."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(points) < 3 or bool(spread[1] <= _ON_A_LINE * spread[0])
