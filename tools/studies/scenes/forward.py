"""The images of a field, by dense sampling along rays; nothing here is of the reconstruction.

Light of every point of a ray is added by the midpoint rule. A pixel is the mean over its area.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from rigs.camera_protocol import CameraLike
from studies.scenes.fields import Field
from studies.scenes.media import Gas, displacements

STEP = 0.25  # voxels between two samples of a ray. Sheets half a voxel thick are added to 1e-6
SUPERSAMPLE = 2  # rays along each side of a pixel
SAMPLES_AT_ONCE = 1 << 18
DARK = 1e-6  # fraction of the brightest below which emission is not sampled
NO_GAS = Gas()
LOOKS = 3  # points along each side of a cell that is looked into before it counts as dark


def radiance(
    camera: CameraLike,
    field: Field,
    gas: Gas = NO_GAS,
    *,
    supersample: int = SUPERSAMPLE,
    step: float = STEP,
) -> NDArray[np.float64]:
    """Return the image ``(height, width)`` that a camera takes of a field.

    ``supersample`` rays lie along each side of a pixel, two samples at most ``step`` voxels apart.
    A step of the length ``h`` with the emission ``e`` behind ``E``, at the self-absorption ``q``,
    gives ``exp(-q E) (1 - exp(-q e h)) / q``: exact for emission that is constant in it.
    """
    width, height = camera.image_size
    offsets = (np.arange(supersample) + 0.5) / supersample - 0.5
    image = np.zeros((height, width))
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    for right in offsets:
        for down in offsets:
            uv = np.stack([columns + right, rows + down], axis=-1).reshape(-1, 2)
            image += _light(*camera.rays(uv), field, gas, step).reshape(height, width)
    return image / supersample**2


def _light(
    origins: NDArray, directions: NDArray, field: Field, gas: Gas, step: float
) -> NDArray[np.float64]:
    """Return what rays see of a field, ``(rays,)``."""
    self_absorption, absorption, absorber, bending = gas
    grid, found = field.grid, np.zeros(len(origins))
    first, last = crossing(origins, directions, *field.reach)
    hit = np.flatnonzero(last > first)
    if not len(hit):
        return found
    count = int(np.ceil((last - first)[hit].max() / (step * grid.spacing[0])))
    if absorption:
        enters, leaves = crossing(origins, directions, grid.lower, grid.upper)
    for part in np.array_split(hit, max(1, len(hit) * count // SAMPLES_AT_ONCE)):
        length = (last - first)[part] / count  # (rays,)
        along = first[part, None] + (np.arange(count) + 0.5) * length[:, None]
        off = None
        if bending is not None:
            points = origins[part, None] + along[..., None] * directions[part, None]
            off = displacements(bending, points, directions[part], length)
        emission = _sampled(field, origins[part], along, directions[part], off)  # (rays, count)
        light = emission * length[:, None]
        if self_absorption:
            depth = self_absorption * light
            before = np.cumsum(depth, axis=1) - depth
            light = np.exp(-before) * -np.expm1(-depth) / self_absorption
        if absorption:
            inside = np.clip(along, enters[part, None], leaves[part, None]) - enters[part, None]
            light = light * np.exp(-absorption * np.maximum(inside, 0))
        if absorber is not None:
            points = origins[part, None] + along[..., None] * directions[part, None]
            depth = absorber(points) * length[:, None]
            light = light * np.exp(depth / 2 - np.cumsum(depth, axis=1))
        found[part] = light.sum(axis=1)
    return found


def crossing(
    origins: NDArray, directions: NDArray, lower: NDArray, upper: NDArray
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where rays enter and leave a box, ``(rays,)``; those that miss leave before."""
    slope = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
    one, other = (lower - origins) / slope, (upper - origins) / slope
    first = np.maximum(np.minimum(one, other).max(axis=1), 0)
    last = np.maximum(one, other).min(axis=1)
    seen = np.isfinite(directions).all(axis=1)
    return np.where(seen, first, 0), np.where(seen, last, -1)


def _sampled(
    field: Field, origins: NDArray, along: NDArray, directions: NDArray, off: NDArray | None
) -> NDArray[np.float64]:
    """Return the emission ``(rays, count)`` at distances along rays; dark cells are left out.

    The samples lie ``off`` the rays, ``(rays, count, 3)``, by less than a cell.
    """
    lower, cell, lit = _lit_cells(field)
    flat = np.zeros(along.shape, np.int32)
    for axis, most in enumerate(lit.shape):
        start, slope = origins[:, axis] - lower[axis], directions[:, axis]
        position = along * (slope / cell)[:, None] + (start / cell)[:, None]
        flat = flat * most + np.clip(position.astype(np.int32), 0, most - 1)
    ray, sample = np.nonzero(lit.ravel()[flat])
    found = np.zeros(along.shape)
    points = origins[ray] + along[ray, sample, None] * directions[ray]
    found[ray, sample] = field(points if off is None else points + off[ray, sample])
    return found


@lru_cache(maxsize=4)
def _lit_cells(field: Field) -> tuple[NDArray, float, NDArray[np.bool_]]:
    """Return the lower corner, the edge, and which cells of a lattice may hold light."""
    (lower, upper), cell = field.reach, field.grid.spacing[0]
    shape = np.ceil((upper - lower) / cell - 1e-9).astype(int)
    axes = [
        low + cell * (np.arange(n * LOOKS) + 0.5) / LOOKS
        for low, n in zip(lower, shape, strict=True)
    ]
    brightest = np.zeros(shape)
    for number in range(shape[0]):
        own = axes[0][number * LOOKS : (number + 1) * LOOKS]
        values = field(np.stack(np.meshgrid(own, *axes[1:], indexing="ij"), axis=-1))
        parts = values.reshape(LOOKS, shape[1], LOOKS, shape[2], LOOKS)
        brightest[number] = parts.max(axis=(0, 2, 4))
    lit = maximum_filter(brightest, 3) > DARK * brightest.max()
    return lower, cell, lit
