"""How well left-out views are predicted, as a whole and patch by patch of their images."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import dot, norm
from tomo.selection import Choice, solve_as_chosen
from tomo.selection.choose import residual_of_left_out_views
from tomo.selection.folds import Fold, views_to_leave_out
from tomo.wernet.default.linearisation import PixelSubset
from tomo.wernet.default.patches import beyond_noise

if TYPE_CHECKING:
    from tomo.operators import ProjectionOperator, Projector

CONVERGED = 30
"""Iterations at which volumes are compared as well. Fewer: predictions of noisy patches change by
a fifth from one iteration to the next. More: plain voxels of clean images imitate vignetting."""


def evaluated(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    choice: Choice,
    weights: NDArray[np.float32] | None,
) -> Choice:
    """Return the choice with the residual of left-out views: learned weights are kept by it."""
    residual = residual_of_left_out_views(projector, measured, choice, weights)
    return replace(choice, held_out_residual=residual)


def left_out_patch_residuals(
    subset: PixelSubset, weighted: Projector, choice: Choice
) -> NDArray[np.float64]:
    """Return the residual of left-out views summed over patches, relative to their light.

    Noise, and errors of single voxels and rays, mostly cancel within a patch. A loss of light on
    the way to the camera does not. The change of a narrow flame has both signs within a patch, so
    smaller patches are used as well. Each view is predicted up to a factor: the fitted gains of
    left-out views are not to help, only their effect on the volume.

    Parameters
    ----------
    subset : PixelSubset
    weighted : Projector
        The rows of the same pixels, with the weights to be evaluated.
    choice : Choice
        How to solve for the voxels of the remaining views.

    Returns
    -------
    (2, 4) float64
        All of the residual, and the part beyond the noise. Columns: the chosen stop with patches
        and with patches of half the side, then `CONVERGED` volumes with both.
    """
    views = np.flatnonzero(np.diff(weighted.view_ptr)).tolist()
    patches = subset.patches, subset.smaller_patches
    stops = choice.iterations, max(choice.iterations, CONVERGED)
    squared, light = np.zeros((len(stops), len(patches))), np.zeros(len(patches))
    noise = np.full((len(stops), 1), subset.noise**2)  # a sum over a patch has as much as a pixel
    count = np.zeros(len(patches), int)
    for left_out in views_to_leave_out(views):
        fold = Fold.leaving_out_views(left_out, weighted, subset.measured)
        image, misfit = np.zeros((2, weighted.shape[0]))
        pixels = weighted.pixels_of(left_out)
        image[pixels] = fold.left_out_pixels
        light += [norm(each.sum(image)) ** 2 for each in patches]
        count += [np.count_nonzero(np.isin(each.view, left_out)) for each in patches]
        for stop, volume in enumerate(_volumes(fold, choice, stops)):
            misfit[pixels] = _misfit(fold, volume)
            squared[stop] += [norm(each.sum(misfit)) ** 2 for each in patches]
            noise[stop] = np.minimum(noise[stop], norm(misfit) ** 2 / max(len(pixels), 1))
    beyond = np.vectorize(beyond_noise)(squared, noise * count, count)
    return np.array([np.sqrt(squared), beyond]).reshape(2, -1) / np.tile(
        np.sqrt(np.where(light, light, 1.0)), len(stops)
    )


def _volumes(
    fold: Fold, choice: Choice, stops: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the voxels (unknowns,) of one solve at two stops, the later one second."""
    kept = []

    def keep(index: int, volume: NDArray[np.float32], _residual: float) -> None:
        if index == stops[0]:
            kept.append(volume.copy())

    longer = replace(choice, iterations=stops[1])
    found = solve_as_chosen(fold.training, fold.training_pixels, longer, callback=keep)
    last = fold.training.active.compress(found.volume)
    return (*kept, last)[0], last


def _misfit(fold: Fold, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the error of predicted left-out views, each scaled to its image: ``(pixels,)``."""
    predicted, there = fold.left_out @ volume, fold.left_out_pixels
    for start, stop in itertools.pairwise(fold.left_out.view_ptr):
        own = slice(start, stop)
        predicted[own] *= dot(predicted[own], there[own]) / (
            dot(predicted[own], predicted[own]) or 1.0
        )
    return predicted - there
