"""Two cameras that have each other's images: the volume made of all views tells.

Where two of few views are exchanged, no single camera stands out: the others are too few to agree
without both. All images are therefore explained anew with two of them exchanged, pair by pair.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.operators.system import VolumeNotSeenError
from tomo.screening.left_out_prediction import PredictedViews
from tomo.screening.single_camera import EXPLAINS, errors_of

SUSPECTS = 8
"""Views explained least, whose pairs are tried: 28 volumes of the coarse system at most."""

FEWEST = 3
"""Views. Two are exchanged by renaming one another: any volume explains them."""


@dataclass(frozen=True)
class Exchanged:
    """Two cameras that have each other's images.

    Attributes
    ----------
    cameras : (str, str)
    left : float
        All images' squared error beyond noise with the two exchanged, over that as they are.
    """

    cameras: tuple[str, str]
    left: float


def find_exchanged(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    noise: Sequence[NoiseModel],
) -> Exchanged | None:
    """Return the two cameras whose images, exchanged, agree best with the rest; None for none.

    Parameters
    ----------
    rig : Rig
    images : sequence of (height, width) float32
        One a camera.
    masks : sequence of (height, width) bool
    grid : VoxelGrid
    noise : sequence of NoiseModel

    Notes
    -----
    Only images of one size are exchanged. The two are named where the squared error of all images
    falls to half, the limit for the causes of one camera.
    """
    shown = explained_anew(rig, images, masks, grid, noise)
    if shown is None:
        return None
    views, everyone, errors = shown
    worst = sorted(everyone, key=lambda view: -errors[view])[:SUSPECTS]
    sizes = [camera.image_size for camera in rig]
    found = {
        pair: float(errors_of(other, other.volume(everyone))[everyone].sum())
        for pair in itertools.combinations(sorted(worst), 2)
        if sizes[pair[0]] == sizes[pair[1]]
        for other in [_with_exchanged(views, *pair)]
    }
    if not found:
        return None
    best = min(found, key=found.__getitem__)
    left = found[best] / float(errors[everyone].sum())
    return Exchanged((rig.names[best[0]], rig.names[best[1]]), left) if left < EXPLAINS else None


def explained_anew(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    noise: Sequence[NoiseModel],
    trusted: int | None = None,
) -> tuple[PredictedViews, list[int], NDArray[np.float64]] | None:
    """Return the views, which of them make a volume, and each one's squared error beyond noise.

    Parameters
    ----------
    rig, images, masks, grid, noise
        See `find_exchanged`.
    trusted : int, optional
        Only the first so many cameras make volumes; all when None.

    Returns
    -------
    tuple or None
        The errors are those of all views, ``(views,)``. None where fewer than `FEWEST` views of
        those trusted see the grid.
    """
    used = list(range(len(rig) if trusted is None else trusted))
    if len(used) < FEWEST:
        return None
    try:
        views = PredictedViews.of(rig, images, masks, grid, noise)
    except VolumeNotSeenError:
        return None
    used = [view for view in used if views.sees(view)]
    if len(used) < FEWEST:
        return None
    return views, used, errors_of(views, views.volume(used))


def _with_exchanged(views: PredictedViews, first: int, second: int) -> PredictedViews:
    """Return the views with two images in each other's place."""
    order = list(range(len(views.noise)))
    order[first], order[second] = second, first
    images = [views.coarse.images[view] for view in order]
    return replace(views.with_images(images), noise=tuple(views.noise[view] for view in order))
