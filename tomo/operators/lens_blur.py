"""How the light of a pixel's line is spread over its neighbours by a lens out of focus."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from rigs import Camera, Rig
from tomo._compute.memory import available_memory
from tomo.grid import VoxelGrid

ACROSS = 32
MOST_POINTS = 256
"""Points along the side of a pixel, by which the disc's share of it is measured, and along the
disc: of a large one few pixels are cut by its edge."""

BYTES = 24
"""That a pixel within the disc of another takes while they are found."""

BOX = 4 / 3
"""The square of a disc's diameter over that of a box's side that spreads as much: a disc's
variance along an axis is ``d² / 16``, a box's ``h² / 12``."""


def spread_of(
    rig: Rig, pixels: Sequence[NDArray[np.integer]], grid: VoxelGrid, blur: float
) -> scipy.sparse.csr_array:
    """Return which share of the light of each pixel's line reaches which pixel.

    Parameters
    ----------
    rig : Rig
    pixels : sequence of (P_v,) int
        Of each camera the flat numbers ``row * width + column`` of the pixels that take part. The
        lines of others are taken to be dark.
    grid : VoxelGrid
        Of the voxels to be projected. These are boxes and blur by themselves what is projected:
        the disc is smaller by as much.
    blur : float
        Diameter of the disc at the grid's centre, in the rig's length unit, see `blur_of_images`.
        It is the same at all depths: of a flame, far smaller than its distance, it nearly is.

    Returns
    -------
    (pixels, pixels) float32
        View after view; nothing passes between views.

    Raises
    ------
    ValueError
        If the blur is not a number above 0, a camera has the grid's centre behind it, a disc is
        larger than its image, or all of them would not fit in memory.
    """
    if not (math.isfinite(blur) and blur > 0):
        raise ValueError(f"blur: found {blur}, expected a diameter above 0")
    by_itself = BOX * float(np.mean(np.square(grid.spacing)))
    width = math.sqrt(max(blur**2 - by_itself, 0.0))
    sizes = rig.footprint(grid.center)
    discs = [_disc_of(camera, size, width) for camera, size in zip(rig, sizes, strict=True)]
    return spread_by(rig, pixels, discs, f"blur: found {blur:g}: its discs")


def spread_by(
    rig: Rig,
    pixels: Sequence[NDArray[np.integer]],
    shares: Sequence[tuple[NDArray[np.int64], NDArray[np.float32]]],
    what: str,
) -> scipy.sparse.csr_array:
    """Return which share of the light of each pixel's line reaches which pixel.

    Parameters
    ----------
    rig : Rig
    pixels : sequence of (P_v,) int
        See `spread_of`.
    shares : sequence of ((n, 2) int64, (n,) float32)
        Of each camera the pixels that a line's light reaches, in columns and rows from its own,
        and how much of it reaches each.
    what : str
        What takes the memory, for the error.

    Returns
    -------
    (pixels, pixels) float32
        View after view; nothing passes between views.

    Raises
    ------
    ValueError
        If all of them would not fit in memory.
    """
    reached = [len(kept) * len(share) for kept, (_, share) in zip(pixels, shares, strict=True)]
    needed, available = BYTES * (max(reached) + sum(reached)), available_memory()
    if needed > available:
        raise ValueError(
            f"{what} would take about {needed / 1e9:.1f} GB, expected at most "
            f"{available / 1e9:.1f} GB: use smaller images (--scale)"
        )
    views = [
        _of_view(camera, kept, apart, share)
        for camera, kept, (apart, share) in zip(rig, pixels, shares, strict=True)
    ]
    return scipy.sparse.csr_array(scipy.sparse.block_diag(views, format="csr", dtype=np.float32))


def _disc_of(
    camera: Camera, size: float, width: float
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the `disc` of a diameter where a camera's pixels have a size."""
    if not size > 0:
        raise ValueError(
            f"blur: camera {camera.name}: found the grid's centre behind it, expected it ahead"
        )
    if width > size * max(camera.image_size):
        raise ValueError(
            f"blur: camera {camera.name}: found a disc of {width / size:.0f} pixels, expected one "
            f"within its image of {camera.image_size[0]} x {camera.image_size[1]}"
        )
    return disc(width / size)


def _of_view(
    camera: Camera,
    pixels: NDArray[np.integer],
    apart: NDArray[np.int64],
    share: NDArray[np.float32],
) -> scipy.sparse.csr_array:
    """Return the shares within one view, those in each of the pixels of its disc given."""
    reach = int(np.abs(apart).max())
    columns, rows = camera.image_size
    number = np.full((rows + 2 * reach, columns + 2 * reach), -1)
    row, column = pixels // columns + reach, pixels % columns + reach
    number[row, column] = np.arange(len(pixels))
    near = number[row[:, None] + apart[:, 1], column[:, None] + apart[:, 0]]  # (pixels, offsets)
    there = near >= 0
    shares = np.broadcast_to(share, near.shape)[there]
    pointers = np.concatenate([[0], np.cumsum(there.sum(axis=1))])
    return scipy.sparse.csr_array((shares, near[there], pointers), (len(pixels), len(pixels)))


def disc(width: float) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the pixels that a disc about a pixel's centre reaches, and its share in each.

    Parameters
    ----------
    width : float
        Its diameter in pixels; 0: all of it is in its own pixel.

    Returns
    -------
    apart : (n, 2) int64
        Columns and rows from that pixel.
    share : (n,) float32
    """
    reach = math.ceil(width / 2 - 0.5) if width > 1 else 0
    across = min(ACROSS, max(MOST_POINTS // (2 * reach + 1), 1))
    points = (np.arange((2 * reach + 1) * across) + 0.5) / across - 0.5 - reach  # from its centre
    inside = np.square(points)[:, None] + np.square(points) <= (max(width, 1e-9) / 2) ** 2
    cells = inside.reshape(2 * reach + 1, across, 2 * reach + 1, across).sum(axis=(1, 3))
    if not cells.any():  # narrower than the points are apart
        cells[reach, reach] = 1
    rows, columns = np.nonzero(cells)
    share = cells[rows, columns] / cells.sum()
    return np.stack([columns, rows], axis=1) - reach, share.astype(np.float32)
