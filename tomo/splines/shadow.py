"""How much a voxel's shadow and a pixel's area blur an image, and the shares that do the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from rigs import Rig, image_motion
from rigs.camera import Camera
from rigs.ray_table import RayTable
from tomo.defocus import spread_by
from tomo.grid import VoxelGrid

ALONG = np.linspace(-0.5, 0.5, 9)
WEIGHTS = np.array([0.5, 1, 1, 1, 1, 1, 1, 1, 0.5]) / 8
"""Points along each edge of a voxel, and how much of it each stands for."""

FAINTEST = 1e-3
"""Shares below this of the largest are left to the others."""


def shadow_spread(
    rig: Rig,
    pixels: Sequence[NDArray[np.integer]],
    seeing: NDArray[np.bool_],
    grid: VoxelGrid,
    supersample: int = 1,
) -> scipy.sparse.csr_array:
    """Return which share of the light of each pixel's line reaches which pixel.

    Linear splines are boxes blurred by a box, ``hat = box * box``, and a projection of a blurred
    volume is a projection blurred by the blur's own: chords through boxes, as sharp lines see
    them, blurred by the shadow of a voxel and by the area of a pixel, are what pixels see of
    splines. The shadow is taken to be as large as that of a voxel in the middle.

    Parameters
    ----------
    rig : Rig
    pixels : sequence of (P_v,) int
        Of each camera the flat numbers ``row * width + column`` of the pixels that take part.
    seeing : (pixels,) bool
        Whether a pixel's line crosses a voxel. The others show nothing, and count as if they took
        no part.
    grid : VoxelGrid
    supersample : int
        Lines along each side of a pixel, whose mean is given: as much of its area is in there.

    Returns
    -------
    (pixels, pixels) float32
        View after view. Every row of a pixel that sees something sums to one: what would come
        from pixels that take no part, beyond the image or damaged, is taken to be as in the pixel
        itself. Where these are dark it is so itself.

    Raises
    ------
    ValueError
        If a camera has the grid's centre behind it, or the shares would not fit in memory.
    """
    kernels = [_shadow(camera, grid, supersample) for camera in rig]
    own = np.flatnonzero(seeing)
    of_views = np.split(seeing, np.cumsum([len(kept) for kept in pixels])[:-1])
    seen = [kept[some] for kept, some in zip(pixels, of_views, strict=True)]
    among = spread_by(rig, seen, kernels, "basis: found splines: their shares")
    missing = 1.0 - among.sum(axis=1, dtype=np.float64)
    among = (among + scipy.sparse.diags_array(missing.astype(np.float32))).tocsr()
    pointers = np.zeros(len(seeing) + 1, np.int64)
    pointers[own + 1] = np.diff(among.indptr)
    return scipy.sparse.csr_array(
        (among.data, own[among.indices], np.cumsum(pointers)), (len(seeing), len(seeing))
    )


def _shadow(
    camera: Camera | RayTable, grid: VoxelGrid, supersample: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the pixels that the shadow about a pixel reaches, and its share in each.

    ``apart`` (n, 2), columns and rows, and ``share`` (n,): those of the pixel's area, moved along
    with points spread over the shadow of a voxel, in each pixel. To count area by pixels blurs
    once more, by more or less as edges happen to lie: the shares are scaled to spread as much as
    shadow and area do.
    """
    centre = np.asarray(grid.center)
    edges = np.stack(
        [
            image_motion(camera, centre[None], step)[0] * 2
            for step in np.diag(np.asarray(grid.spacing) / 2)
        ]
    )  # (3, 2): the image of each edge of a voxel
    if not np.isfinite(edges).all():
        raise ValueError(
            f"basis: camera {camera.name}: found the grid's centre out of its sight, expected it "
            "ahead"
        )
    middle, weight = np.zeros((1, 2)), np.ones(1)
    for edge in edges:
        middle = (middle[:, None] + ALONG[:, None] * edge).reshape(-1, 2)
        weight = np.outer(weight, WEIGHTS).ravel()
    side = 1 / supersample
    first = np.floor(middle - side / 2 + 0.5)  # the pixel that the area's lower edge is in
    beyond = np.clip((middle + side / 2 - first - 0.5) / side, 0, 1)  # of it, in the next
    reach = int(np.abs(first).max()) + 1
    width = 2 * reach + 1
    found = np.zeros(width**2)
    for corner in np.ndindex(2, 2):
        cells = (first + corner + reach).astype(np.int64) @ [1, width]
        part = np.where(corner, beyond, 1 - beyond).prod(axis=1)
        found += np.bincount(cells, weight * part, minlength=width**2)
    found = ((found + found[::-1]) / 2).reshape(width, width)  # as even as shadow and area are
    rows, columns = np.nonzero(found > FAINTEST * found.max())
    offsets = np.stack([columns, rows], axis=1) - reach
    share = found[rows, columns] / found[rows, columns].sum()
    wanted = (float(np.square(edges).sum()) + 2 * side**2) / 12
    scale = wanted / float(share @ np.square(offsets).sum(axis=1))
    own = (offsets == 0).all(axis=1)
    share = np.where(own, 1 - scale * (1 - share), scale * share)
    return offsets, share.astype(np.float32)
