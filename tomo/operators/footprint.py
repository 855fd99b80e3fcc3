"""How much a voxel's shadow and a pixel's area blur an image, and the shares that do the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray

from rigs import Rig, image_motion
from rigs.camera_protocol import CameraLike
from tomo.grid import VoxelGrid
from tomo.operators.lens_blur import spread_by

STEEPNESS, LONGEST = 4.0, 6.0
"""Waves of a flame are taken to fall as the fourth power of their number of periods a voxel, from
where they are as long as six voxels."""

FINEST = 1.5
"""Periods a pixel, along each axis, up to which waves are looked at: what pixels cannot show
they show as longer waves."""

WAVES, FEWEST_WAVES = 4, 48
"""Steps up to there along each axis, for each pixel that shares reach, and in all: between copies,
with few pixels a voxel, the waves of a flame take up little room."""

MOST_FITTED = 200
"""Shares, of two pixels each, that are fitted: far more would take seconds."""

SURELY, NEARLY = 1e3, 0.1
"""Times all waves that the shares' sum counts by, and how far they spread: solvers undo a blur of
long waves that is not there. With 0 jets are 3 to 7 % further from the truth, with 1 they are 3 to
6 % nearer, but wide blobs, along whose voxels two of 14 cameras look, 30 to 40 % further."""

MOST_STEPS = 100_000
"""Of the fit, which takes about as many as there are shares: it ends, but not by this."""

FAINTEST = 1e-3
"""Shares below this of the largest are left to the pixel itself."""


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
    camera: CameraLike, grid: VoxelGrid, supersample: int
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the pixels that the shadow about a pixel reaches, and its share in each.

    ``apart`` (n, 2), columns and rows, and ``share`` (n,), as of `shares_of_shadow`.
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
    return shares_of_shadow(edges, supersample)


def shares_of_shadow(
    edges: NDArray[np.float64], supersample: int = 1
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return the shares, none below zero, that blur chords through boxes as a shadow does.

    Of a wave with ``f`` periods a pixel the box of an edge ``e`` leaves ``sinc(f . e)``, the area
    about each of a pixel's ``n²`` lines ``sinc(f_x / n) sinc(f_y / n)``; shares ``s`` in pixels
    ``d`` apart leave ``sum s cos(2 pi f . d)``. The squared difference is least over the waves of
    lines through boxes. These are the flame's own, which fall towards short ones, and copies of
    them about each whole number of periods a voxel: what makes boxes of a flame. How far shares
    spread counts beside them: as far as shadow and area do it would be
    ``sum s d d' = sum e e' / 12 + I / (12 n²)``, and long waves as they should be. (The area of
    the shadow in each pixel spreads just so far, but lets copies through: of a camera that looks
    along voxels' faces they were 1.4 % of the image.)

    Parameters
    ----------
    edges : (3, 2) float64
        The image of each edge of a voxel, columns and rows.
    supersample : int
        ``n``, lines along each side of a pixel.

    Returns
    -------
    apart : (m, 2) int64
        Columns and rows from a pixel.
    share : (m,) float32
        Their sum is one.
    """
    reach = np.maximum((np.abs(edges).sum(axis=0) / 2 + 0.5 / supersample + 0.5).astype(int), 1)
    columns, rows = np.meshgrid(*(np.arange(-n, n + 1) for n in reach), indexing="ij")
    apart = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    apart = apart[len(apart) // 2 + 1 :]  # behind the pixel itself, and their mirrors before it
    found = _fitted if len(apart) <= MOST_FITTED else _transformed
    share = found(edges, supersample, apart)
    there = share > FAINTEST * max(float(share.max()), 1 - 2 * float(share.sum()))
    apart, share = apart[there], share[there]
    own = max(1 - 2 * float(share.sum()), 0.0)  # rounding aside it is not below
    return (
        np.concatenate([-apart, np.zeros((1, 2), np.int64), apart]),
        np.concatenate([share, [own], share]).astype(np.float32),
    )


def _fitted(
    edges: NDArray[np.float64], supersample: int, apart: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the shares by least squares, of each of two pixels that are each other's mirror."""
    count = max(WAVES * int(np.abs(apart).max()), FEWEST_WAVES)
    half = (np.arange(count) + 0.5) / count * FINEST
    plane = np.meshgrid(np.concatenate([-half[::-1], half]), half, indexing="ij")
    waves = np.stack(plane, axis=-1).reshape(-1, 2)  # one of each two that are each other's mirror
    periods = waves @ edges.T  # (waves, 3), a voxel
    box = np.sinc(periods).prod(axis=1)
    area = np.sinc(waves / supersample).prod(axis=1)
    lines = np.sinc(waves).prod(axis=1) / area  # what the mean of a pixel's lines leaves
    length = np.sqrt(np.square(periods - np.rint(periods)).sum(axis=1) + LONGEST**-2)
    weight = np.abs(box * lines) / length**STEEPNESS
    kept = np.cos(2 * np.pi * waves @ apart.T)  # (waves, shares)
    matrix = weight[:, None] * np.column_stack([np.ones(len(waves)), 2 * kept])
    wanted = weight * box * area
    spread = (edges.T @ edges + np.eye(2) / supersample**2) / 12  # (2, 2)
    nearly, both = NEARLY / np.trace(spread), np.triu_indices(2)
    of_pairs = 2 * (apart[:, both[0]] * apart[:, both[1]]).T  # (3, shares)
    sums = np.vstack([np.full(len(apart), 2 * SURELY), nearly * of_pairs])
    sums = np.column_stack([[SURELY, 0, 0, 0], sums])
    all_waves = float(np.linalg.norm(wanted))
    matrix = np.vstack([matrix, all_waves * sums])
    wanted = np.append(wanted, all_waves * np.append(SURELY, nearly * spread[both]))
    share, _ = scipy.optimize.nnls(matrix, wanted, maxiter=MOST_STEPS)
    return share[1:] / (share[0] + 2 * share[1:].sum())


def _transformed(
    edges: NDArray[np.float64], supersample: int, apart: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the shares of a shadow so wide that hardly a wave which pixels can show is left."""
    sides = 4 * np.abs(apart).max(axis=0)
    plane = np.meshgrid(*(np.fft.fftfreq(n) for n in sides), indexing="ij")
    waves = np.stack(plane, axis=-1)  # (columns, rows, 2)
    left = np.sinc(waves @ edges.T).prod(axis=-1) * np.sinc(waves / supersample).prod(axis=-1)
    shares = np.maximum(np.fft.ifft2(left).real, 0)
    half = shares[tuple(apart.T)]
    return half / (shares[0, 0] + 2 * half.sum())
