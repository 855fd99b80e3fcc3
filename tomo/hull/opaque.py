"""The visual hull of opaque things: the voxels that no silhouette excludes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.hull.dark_votes import dark_votes, touched
from tomo.hull.projection_lattice import Lattice
from tomo.measurement import check_sizes

if TYPE_CHECKING:
    from rigs import CameraLike


@dataclass(frozen=True, eq=False)
class VisualHull:
    """The voxels inside all silhouettes, and how well they explain them."""

    grid: VoxelGrid
    inside: NDArray[np.bool_]  # (nx, ny, nz)
    images: tuple[NDArray[np.bool_], ...]  # (height, width): the pixels that see the hull
    overlaps: NDArray[np.float64]
    """Intersection over union with each silhouette, of usable pixels; NaN of none."""


def visual_hull(
    cameras: Sequence[CameraLike],
    silhouettes: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    *,
    votes: int = 1,
) -> VisualHull:
    """Return the voxels that no silhouette excludes, and the pixels that see them.

    ``silhouettes`` are True where a pixel sees the thing, ``masks`` where it is usable: others
    exclude nothing. Voxels are to be as wide as a pixel or two: the hull is larger than the thing
    by up to a voxel. ``votes`` are the views that must exclude a voxel, 1 to 255; more than one
    where cameras are inexact. ValueError: images do not fit the cameras.

    Laurentini, "The visual hull concept for silhouette-based image understanding", IEEE PAMI 16,
    1994. Hollows that no silhouette shows are filled.
    """
    check_sizes("silhouettes", silhouettes, cameras)
    usable = [np.ones(own.shape, bool) for own in silhouettes] if masks is None else masks
    open_to = [own | ~known for own, known in zip(silhouettes, usable, strict=True)]
    lattices = Lattice.of_all(cameras, grid)
    found = dark_votes(open_to, lattices, grid.shape, margin=0.0, enough=votes)
    inside = found < votes
    images = touched(inside, lattices, [own.shape for own in silhouettes])
    overlaps = [
        _overlap(one & known, own & known)
        for one, own, known in zip(images, silhouettes, usable, strict=True)
    ]
    return VisualHull(grid, inside, tuple(images), np.array(overlaps))


def silhouette(
    image: NDArray[np.floating], threshold: float, *, close: int = 0, grow: int = 0
) -> NDArray[np.bool_]:
    """Return the pixels above ``threshold``, those of a bright thing before a dark background.

    Gaps narrower than twice ``close`` pixels are closed, and holes are filled: dark folds; 0:
    neither. The rest grows by ``grow`` pixels: by as many cameras may point wrongly.
    """
    from scipy import ndimage

    bright = np.pad(image > threshold, close)
    if close:
        apart = ndimage.distance_transform_edt(~bright) if bright.any() else np.full(1, np.inf)
        bright = ndimage.binary_fill_holes(bright | (apart <= close))
        bright = ndimage.distance_transform_edt(np.pad(bright, 1))[1:-1, 1:-1] > close
    rows, columns = image.shape
    bright = bright[close : close + rows, close : close + columns]
    if grow and bright.any():
        bright = ndimage.distance_transform_edt(~bright) <= grow
    return bright


def otsu(images: Sequence[NDArray[np.floating]]) -> float:
    """Return the level that parts bright from dark pixels best: the largest variance between.

    Otsu, "A threshold selection method from gray-level histograms", IEEE SMC 9, 1979.
    """
    values = np.sort(np.concatenate([image.ravel() for image in images]).astype(np.float64))
    if not values[-1] > values[0]:
        raise ValueError(
            f"threshold: found images of {values[0]:g} alone, expected a bright thing"
        )
    light, below = np.cumsum(values), np.arange(1, values.size)
    above = values.size - below
    apart = light[:-1] / below - (light[-1] - light[:-1]) / above
    is_step = values[1:] > values[:-1]
    best = int(np.argmax(np.where(is_step, below * above * apart**2, -1.0)))
    return float(values[best : best + 2].mean())


def _overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    either = np.count_nonzero(one | other)
    has_thing = other.any()
    return np.count_nonzero(one & other) / either if has_thing and either else float("nan")
