"""A first guess of what weights a scene needs: few numbers, with the voxels eliminated."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._sums import dot
from tomo.smooth_basis import SmoothBasis
from tomo.solve import cgls
from tomo.solve.stopping import (
    Choice,
    choose_by_held_out_views,
    residual_of_left_out_views,
    solve_as_chosen,
)
from tomo.wernet.correction import ViewTokens
from tomo.wernet.ray_features import TRENDS, RayFeatures
from tomo.wernet.ray_weights import reweighted, trend_corrections, with_lengths

if TYPE_CHECKING:
    from tomo.projector import Projector
    from tomo.viewed import ViewedOperator

STEPS = 3
PIXELS_AN_UNKNOWN = 3
PRIOR = 0.3
"""Standard deviation of the correction that one number may make, before the images are asked."""

PATCH = 0.2
"""Side of the patches that an image's residuals are summed over, where the widest image is two
across. What voxels and single rays leave out changes sign within a patch, what light loses on its
way does not."""

WORTH = 0.85
"""A trend must lower the left-out views' residual to this share of that without it, each solved as
suits it best: by a tenth it also imitates what voxels and single rays leave out."""


def first_guess(
    projector: Projector, measured: NDArray[np.float32], choice: Choice, unit: float
) -> ViewTokens:
    """Return levels of the views and trends along the rays that predict left-out views best.

    What dims along a ray, by depth or by the emission in front, the voxels imitate almost: the
    images hardly change, the volume does. Steps of the encoder at fixed voxels see none of that
    and come near very slowly. These few numbers ``t`` are therefore found with the voxels
    eliminated: Gauss-Newton steps on the residual ``m - A(t) x(t)``, ``x(t)`` the solve with
    weights ``A(t)``. Its derivative is that of the rows at fixed voxels less what voxels can
    imitate of it (Kaufman's form of variable projection)::

        J_k = y_k - A z_k,   y_k = (dA / dt_k) x,   z_k the solve of A z = y_k

    For the levels of the views, of which the voxels can imitate little, ``J = y``. Trends are
    added one by one, as long as left-out views are predicted better.

    Parameters
    ----------
    projector : Projector
        Of chord lengths, with midpoints.
    measured : (pixels,) float32
    choice : Choice
        How to solve for the voxels.
    unit : float
        Of the emission in front.

    References
    ----------
    Kaufman, "A variable projection method for solving separable nonlinear least squares problems",
    BIT 15 (1975).
    """
    stride = max(projector.shape[0] // (PIXELS_AN_UNKNOWN * max(projector.shape[1], 1)), 1)
    pixels = np.arange(0, projector.shape[0], stride)
    some, images = projector.take(pixels), measured[pixels]
    features = RayFeatures.of(some)
    patches = _Patches.of(some, features)
    best, chosen = ViewTokens(projector.n_views, 1), ()
    _fit(best, some, images, features, patches, choice, unit, chosen)
    # What still disagrees asks for more smoothness than what is left once it is explained.
    learned = _learned(some, images, features, best, choice, unit)
    choice = choose_by_held_out_views(learned, images)
    while len(chosen) < len(TRENDS):
        trials = []
        for trend in sorted(set(range(len(TRENDS))) - set(chosen)):
            tokens = copy.deepcopy(best)
            _fit(tokens, some, images, features, patches, choice, unit, (*chosen, trend))
            learned = _learned(some, images, features, tokens, choice, unit)
            residual = residual_of_left_out_views(learned, images, choice)
            trials.append((residual, trend, tokens, learned))
        _, trend, tokens, learned = min(trials, key=lambda trial: trial[0])
        found = choose_by_held_out_views(learned, images)
        if not found.held_out_residual < WORTH * choice.held_out_residual:
            break
        best, chosen, choice = tokens, (*chosen, trend), found
    return best


@dataclass(frozen=True, eq=False)
class _Patches:
    """Neighbouring pixels of a view, taken together.

    Attributes
    ----------
    of_pixel : (pixels,) int64
    view : (patches,) int64
    root_size : (patches,) float64
        The square root of its number of pixels.
    """

    of_pixel: NDArray[np.int64]
    view: NDArray[np.int64]
    root_size: NDArray[np.float64]

    @classmethod
    def of(cls, projector: Projector, features: RayFeatures) -> _Patches:
        """Cut each view's pixels into squares of side `PATCH` by their place in the image."""
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        square = np.floor(features.place.numpy() / PATCH).astype(np.int64)  # (pixels, 2)
        found, of_pixel, size = np.unique(
            np.column_stack([view, square]), axis=0, return_inverse=True, return_counts=True
        )
        return cls(of_pixel.reshape(-1), found[:, 0], np.sqrt(size))

    def sum(self, image: NDArray) -> NDArray[np.float64]:
        """Return the patches' sums of ``image`` (pixels,), white noise keeping its size."""
        return np.bincount(self.of_pixel, image, len(self.view)) / self.root_size


def _learned(
    projector: Projector,
    measured: NDArray[np.float32],
    features: RayFeatures,
    tokens: ViewTokens,
    choice: Choice,
    unit: float,
) -> Projector:
    """Return the projector with the weights of the tokens."""
    volume = volume_with(projector, measured, features, tokens, choice, unit)
    front = features.emission_in_front(volume, unit)
    return reweighted(projector, trend_corrections(tokens, features, front))


def _fit(
    tokens: ViewTokens,
    projector: Projector,
    measured: NDArray[np.float32],
    features: RayFeatures,
    patches: _Patches,
    choice: Choice,
    unit: float,
    trends: Sequence[int],
) -> None:
    """Fit levels and ``trends`` to the images, in place."""
    for _ in range(STEPS):
        volume = volume_with(projector, measured, features, tokens, choice, unit)
        front = features.emission_in_front(volume, unit)
        columns = features.trends(front)
        scale = [math.sqrt(dot(column, column) / len(column)) + 1e-6 for column in columns]
        learned = reweighted(projector, trend_corrections(tokens, features, front))
        basis = SmoothBasis(learned, choice.width) if choice.width else learned
        free = _solved(basis, measured, choice)
        if isinstance(basis, SmoothBasis):
            free = basis.blur(free)
        residual = (measured - learned @ free).astype(np.float64)
        slope = 2 * learned.segments.length
        rows = [
            _not_imitated(basis, with_lengths(projector, slope * columns[k]) @ free, choice)
            / scale[k]
            for k in trends
        ]
        level = with_lengths(projector, slope) @ free
        rows = [patches.sum(row) for row in rows]
        step = _gauss_newton(rows, patches.sum(level), patches.view, patches.sum(residual), tokens)
        with torch.no_grad():
            for k, change in zip(trends, step, strict=False):
                # Light dims on its way: brightening is what coarse voxels and pixels look like.
                tokens.trend[k] = min(float(tokens.trend[k]) + float(change / scale[k]), 0.0)
            levels = tokens.level.numpy() + step[len(trends) :]
            tokens.level.copy_(torch.from_numpy((levels - levels.mean()).astype(np.float32)))


def volume_with(
    projector: Projector,
    measured: NDArray[np.float32],
    features: RayFeatures,
    tokens: ViewTokens,
    choice: Choice,
    unit: float,
) -> NDArray[np.float32]:
    """Return the voxels (unknowns,) of levels and trends, with the emission in front theirs."""
    front = torch.zeros_like(features.length)
    for _ in range(2 if tokens.trend[1] else 1):
        learned = reweighted(projector, trend_corrections(tokens, features, front))
        volume = projector.live.compress(solve_as_chosen(learned, measured, choice).volume)
        front = features.emission_in_front(volume, unit)
    return volume


def _not_imitated(
    basis: ViewedOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float64]:
    """Return what is left of ``image`` once voxels, of any sign, have imitated it."""
    return (image - basis @ _solved(basis, image, choice)).astype(np.float64)


def _solved(
    basis: ViewedOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float32]:
    """Return coefficients of any sign: where some are held at zero, a solve is not linear."""
    found = cgls(basis, image, iterations=choice.iterations, nonnegative=False)
    return basis.live.compress(found.volume)


def _gauss_newton(
    rows: Sequence[NDArray[np.float64]],
    level: NDArray[np.float64],
    view: NDArray[np.integer],
    residual: NDArray[np.float64],
    tokens: ViewTokens,
) -> NDArray[np.float64]:
    """Return the change of each trend, in units of its column's size, and of each level.

    All but the tokens have one number a patch, ``(patches,)``.
    """
    n, views = len(rows), len(tokens.level)
    normal, right = np.zeros((n + views, n + views)), np.zeros(n + views)
    places = np.arange(n, n + views)
    normal[places, places] = np.bincount(view, level * level, views)
    right[n:] = np.bincount(view, level * residual, views)
    for i, row in enumerate(rows):
        normal[i, n:] = normal[n:, i] = np.bincount(view, level * row, views)
        right[i] = dot(row, residual)
        for j, other in enumerate(rows):
            normal[i, j] = dot(row, other)
    least = 1e-30 * float(normal.diagonal().max()) or 1.0  # dark views leave rows of nothing
    ridge = max(float(np.mean(residual**2)) / PRIOR**2, least)
    return np.linalg.solve(normal + ridge * np.eye(n + views), right)
