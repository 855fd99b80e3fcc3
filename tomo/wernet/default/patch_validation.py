"""How well views left out are predicted, patch by patch of their images."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo._compute.reductions import dot, norm
from tomo.selection import Choice
from tomo.selection.choose import solve_as_chosen
from tomo.selection.cross_validation import Fold, views_to_leave_out
from tomo.wernet.default.linearised import Thinned
from tomo.wernet.default.patch_noise import beyond_noise

if TYPE_CHECKING:
    from tomo.operators import Projector

SETTLED = 30
"""Iterations to judge by as well. Stopped earlier, patches of noisy images are predicted up to a
fifth better or worse from one iteration to the next, and what is compared settles at paces of its
own. Run on, plain voxels of clean images lose sight of what a lens changes."""


def residuals_of_left_out_patches(
    some: Thinned, weighted: Projector, choice: Choice
) -> NDArray[np.float64]:
    """Return the residual of left-out views, summed over patches, over their light so summed.

    Noise, and what voxels and single rays leave out, mostly cancel within a patch. What light
    loses on its way does not: where single pixels are ruled by the former, patches still tell.
    What a narrow flame's light loses changes sign across it, within a patch: smaller ones tell it.
    No volume predicts what noise makes of the patches all the same.
    Each view is predicted up to a factor: levels are fitted to all views, those left out too, and
    are to be judged by what they do to the volume.

    Parameters
    ----------
    some : Thinned
        Pixels and patches.
    weighted : Projector
        Of the same pixels, with the weights to be judged.
    choice : Choice
        How to solve for the voxels; of the views that `choose_by_held_out_views` leaves out.

    Returns
    -------
    (2, 4) float64
        As they are, and beyond the noise. Stopped as chosen, by patches and by those of half the
        side; where volumes are `SETTLED`, likewise.
    """
    views = np.flatnonzero(np.diff(weighted.view_ptr)).tolist()
    patches = some.patches, some.smaller_patches
    stops = choice.iterations, max(choice.iterations, SETTLED)
    apart, light = np.zeros((len(stops), len(patches))), np.zeros(len(patches))
    noise = np.full((len(stops), 1), some.noise**2)  # a sum over a patch has as much as a pixel
    count = np.zeros(len(patches), int)
    for left_out in views_to_leave_out(views):
        fold = Fold.leaving_out(left_out, views, weighted, some.measured)
        image, misfit = np.zeros((2, weighted.shape[0]))
        pixels = weighted.pixels_of(left_out)
        image[pixels] = fold.left_out_pixels
        light += [norm(each.sum(image)) ** 2 for each in patches]
        count += [np.count_nonzero(np.isin(each.view, left_out)) for each in patches]
        for at, volume in enumerate(_volumes(fold, choice, stops)):
            misfit[pixels] = _misfit(fold, volume)
            apart[at] += [norm(each.sum(misfit)) ** 2 for each in patches]
            noise[at] = np.minimum(noise[at], norm(misfit) ** 2 / max(len(pixels), 1))
    beyond = np.vectorize(beyond_noise)(apart, noise * count, count)
    return np.array([np.sqrt(apart), beyond]).reshape(2, -1) / np.tile(
        np.sqrt(np.where(light, light, 1.0)), len(stops)
    )


def _volumes(
    fold: Fold, choice: Choice, stops: tuple[int, int]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the active voxels after two numbers of iterations, the larger second, of one run."""
    kept = []

    def keep(index: int, volume: NDArray[np.float32], _residual: float) -> None:
        if index == stops[0]:
            kept.append(volume.copy())

    longer = replace(choice, iterations=stops[1])
    found = solve_as_chosen(fold.training, fold.training_pixels, longer, callback=keep)
    last = fold.training.active.compress(found.volume)
    return (*kept, last)[0], last


def _misfit(fold: Fold, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return by how much left-out views are predicted wrongly, each up to a factor."""
    seen, there = fold.left_out @ volume, fold.left_out_pixels
    for start, stop in itertools.pairwise(fold.left_out.view_ptr):
        own = slice(start, stop)
        seen[own] *= dot(seen[own], there[own]) / (dot(seen[own], seen[own]) or 1.0)
    return seen - there
