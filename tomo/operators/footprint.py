"""The footprint of a voxel in an image, as the kernel of the linear basis' image blur."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy.optimize
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from rigs import CameraLike, Rig, image_motion
from tomo.grid import VoxelGrid
from tomo.grid.blur import TRUNCATE
from tomo.operators.image_blur import ImageBlur, Kernel

STEEPNESS, LONGEST = 4.0, 6.0
"""Assumed spectrum of the emission: waves shorter than ``LONGEST`` voxels fall with this power of
their number of periods a voxel. A flatter one fits waves that no flame has, a steeper one leaves
the edges of voxels in."""

FINEST = 1.5
"""Highest frequency fitted along each axis, in periods a pixel: pixels show shorter waves as
longer ones. A lower bound leaves those out, a higher one costs time."""

WAVES, FEWEST_WAVES = 4, 48
"""Frequencies along each axis for each pixel that the kernel reaches, and at least in all: with
fewer, narrow spectral copies fall between the samples."""

MOST_FITTED = 200
"""Largest number of kernel weights that are fitted, in pairs of pixels: more take seconds, and so
wide a footprint leaves hardly a wave that pixels show."""

WIDEST = 500
"""Largest width of a footprint in pixels: its kernel takes 0.1 GB and a quarter of a second. Time
and memory grow with the square; images whose voxels are wider are to be shrunk."""

SUM_WEIGHT, VARIANCE_WEIGHT = 1e3, 0.1
"""Weights of the kernel's sum and of its second moments against the spectral misfit. Without the
second, solvers undo a blur of long waves that is not there; a larger one widens thin blobs."""

MOST_STEPS = 100_000
"""Bound on the steps of the fit, which takes about as many as there are weights."""

FAINTEST = 1e-3
"""Kernel weights below this fraction of the largest go to the pixel itself: a smaller bound makes
the blur slower, a larger one misses light."""


def footprint_blur(
    rig: Rig,
    pixels: Sequence[NDArray[np.integer]],
    seen: NDArray[np.bool_],
    grid: VoxelGrid,
    supersample: int = 1,
    variances: Sequence[float] | None = None,
) -> ImageBlur:
    """Return the image blur by the footprint of a voxel and by the area of a pixel.

    Linear B-splines are voxels blurred by a voxel, ``hat = box * box``, and a projection of a
    blurred volume is a blurred projection. Segment lengths in voxels along single rays, blurred by
    the footprint of a voxel and by the area of a pixel, are what pixels see of the linear basis.
    The footprint is taken to be that of a voxel at the grid's centre.

    ``pixels`` are each camera's flat numbers ``row * width + column`` that take part, ``seen``
    (pixels,) whether the ray of one meets a voxel; the others count as if they took no part. Part
    of a pixel's area is in its ``supersample`` rays along each side. ``variances`` are those of a
    further Gaussian blur of each camera's image, in squared pixels. The weights of a pixel that
    sees something sum to one: light from pixels that take no part, outside the image or excluded,
    is taken to be that of the pixel itself.

    ValueError: the grid's centre is behind a camera, or a voxel is wider there than `WIDEST`
    pixels.
    """
    wider = variances or (0.0,) * len(rig)
    kernels = [
        _widened(_kernel_of(camera, grid, supersample), variance)
        for camera, variance in zip(rig, wider, strict=True)
    ]
    return ImageBlur.from_kernels(rig, pixels, kernels, seen=seen, keeps_light=True)


def _widened(kernel: Kernel, variance: float) -> Kernel:
    """Return the kernel blurred by a Gaussian of a variance in squared pixels."""
    if not variance > 0:
        return kernel
    offsets, weight = kernel
    reach = int(np.abs(offsets).max(initial=0)) + int(np.ceil(TRUNCATE * np.sqrt(variance)))
    dense = np.zeros((2 * reach + 1,) * 2)
    dense[tuple((offsets + reach).T)] = weight
    dense = gaussian_filter(dense, np.sqrt(variance), mode="constant")
    kept = np.argwhere(dense > FAINTEST * dense.max())
    found = dense[tuple(kept.T)]
    return kept - reach, (found / found.sum()).astype(np.float32)


def _kernel_of(camera: CameraLike, grid: VoxelGrid, supersample: int) -> Kernel:
    """Return the `footprint_kernel` of a camera at the grid's centre."""
    centre = np.asarray(grid.center)
    edges = np.stack(
        [
            image_motion(camera, centre[None], step)[0] * 2
            for step in np.diag(np.asarray(grid.spacing) / 2)
        ]
    )  # (3, 2): the image of each edge of a voxel
    if not np.isfinite(edges).all():  # hidden by hardware, or by the edge of a mirror
        edges = _by_pinhole(camera, centre, np.asarray(grid.spacing))
    if not np.isfinite(edges).all():
        raise ValueError(
            f"basis: camera {camera.name}: found the grid's centre out of its sight, expected it "
            "ahead"
        )
    width = float(np.abs(edges).sum(axis=0).max())
    if width > WIDEST:
        raise ValueError(
            f"basis: camera {camera.name}: found a voxel {width:.3g} pixels wide at the grid's "
            f"centre, expected at most {WIDEST}: shrink the images (--scale), take smaller voxels "
            "or --basis voxel, or check the camera's focal length and distortion"
        )
    return _kept_kernel(tuple(edges.ravel().tolist()), supersample)


@lru_cache(maxsize=256)
def _kept_kernel(edges: tuple[float, ...], supersample: int) -> Kernel:
    """Return a kernel; the last ones are kept, since the same cameras are asked for again."""
    return footprint_kernel(np.reshape(edges, (3, 2)), supersample)


def _by_pinhole(
    camera: CameraLike, centre: NDArray[np.float64], spacing: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the image of each edge of a voxel in the nearest pinhole, (3, 2); NaN from behind."""
    seen = camera.camera_matrix @ (camera.R @ centre + camera.t)
    if not seen[2] > 0:
        return np.full((3, 2), np.nan)
    along = camera.camera_matrix @ camera.R * spacing  # (3, edges)
    return ((along[:2] - np.outer(seen[:2] / seen[2], along[2])) / seen[2]).T


def footprint_kernel(edges: NDArray[np.float64], supersample: int = 1) -> Kernel:
    """Return the kernel, >= 0 and of sum one, that blurs projections of voxels to those of hats.

    ``edges`` (3, 2) are the images of each edge of a voxel, in columns and rows; ``supersample``
    is ``n``. At the frequency ``f``, in periods a pixel, a box with the image edge ``e`` passes
    ``sinc(f . e)``, the area around each of a pixel's ``n²`` rays ``sinc(f_x / n) sinc(f_y / n)``,
    and a kernel of weights ``s`` at the offsets ``d`` ``sum s cos(2 pi f . d)``. The kernel has
    the least squared error over the spectrum of a projection of voxels: that of the emission,
    which falls towards short waves, and its copies around each whole number of periods a voxel,
    which are the edges of voxels. The second moments count beside it: footprint and area have
    ``sum s d d' = sum e e' / 12 + I / (12 n²)``. The area of the footprint in each pixel has the
    same moments but lets the copies through.
    """
    reach = np.maximum((np.abs(edges).sum(axis=0) / 2 + 0.5 / supersample + 0.5).astype(int), 1)
    columns, rows = np.meshgrid(*(np.arange(-n, n + 1) for n in reach), indexing="ij")
    half = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    half = half[len(half) // 2 + 1 :]  # the other half are their mirror images
    fit = _fitted if len(half) <= MOST_FITTED else _transformed
    weight = fit(edges, supersample, half)
    kept = weight > FAINTEST * max(float(weight.max()), 1 - 2 * float(weight.sum()))
    half, weight = half[kept], weight[kept]
    own = max(1 - 2 * float(weight.sum()), 0.0)  # below zero by rounding only
    return (
        np.concatenate([-half, np.zeros((1, 2), np.int64), half]),
        np.concatenate([weight, [own], weight]).astype(np.float32),
    )


def _fitted(
    edges: NDArray[np.float64], supersample: int, half: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the weights of the offsets ``half`` by least squares, mirror images alike: (m,)."""
    count = max(WAVES * int(np.abs(half).max()), FEWEST_WAVES)
    axis = (np.arange(count) + 0.5) / count * FINEST
    plane = np.meshgrid(np.concatenate([-axis[::-1], axis]), axis, indexing="ij")
    waves = np.stack(plane, axis=-1).reshape(-1, 2)  # one of each two mirror images
    periods = waves @ edges.T  # (waves, 3), a voxel
    box = np.sinc(periods).prod(axis=1)
    area = np.sinc(waves / supersample).prod(axis=1)
    rays = np.sinc(waves).prod(axis=1) / area  # passed by the mean of a pixel's rays
    length = np.sqrt(np.square(periods - np.rint(periods)).sum(axis=1) + LONGEST**-2)
    importance = np.abs(box * rays) / length**STEEPNESS
    passed = np.cos(2 * np.pi * waves @ half.T)  # (waves, m)
    matrix = importance[:, None] * np.column_stack([np.ones(len(waves)), 2 * passed])
    wanted = importance * box * area
    variance = (edges.T @ edges + np.eye(2) / supersample**2) / 12  # (2, 2)
    factor, both = VARIANCE_WEIGHT / np.trace(variance), np.triu_indices(2)
    moments = 2 * (half[:, both[0]] * half[:, both[1]]).T  # (3, m)
    sums = np.vstack([np.full(len(half), 2 * SUM_WEIGHT), factor * moments])
    sums = np.column_stack([[SUM_WEIGHT, 0, 0, 0], sums])
    all_waves = float(np.linalg.norm(wanted))
    matrix = np.vstack([matrix, all_waves * sums])
    wanted = np.append(wanted, all_waves * np.append(SUM_WEIGHT, factor * variance[both]))
    weight, _ = scipy.optimize.nnls(matrix, wanted, maxiter=MOST_STEPS)
    return weight[1:] / (weight[0] + 2 * weight[1:].sum())


def _transformed(
    edges: NDArray[np.float64], supersample: int, half: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the weights of a wide footprint, which passes hardly a wave that pixels show."""
    sides = 4 * np.abs(half).max(axis=0)
    plane = np.meshgrid(*(np.fft.fftfreq(n) for n in sides), indexing="ij")
    waves = np.stack(plane, axis=-1)  # (columns, rows, 2)
    passed = np.sinc(waves @ edges.T).prod(axis=-1) * np.sinc(waves / supersample).prod(axis=-1)
    kernel = np.maximum(np.fft.ifft2(passed).real, 0)
    weight = kernel[tuple(half.T)]
    return weight / (kernel[0, 0] + 2 * weight.sum())
