"""The box of voxels that images ask for: where cameras look, and where their images are bright."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Rig, point_in_view
from rigs.check.grid_choice import shrinkable, suitable_voxel
from rigs.check.result import RigCheck
from rigs.check.rig_check import check_rig
from tomo.grid import VoxelGrid
from tomo.hull.carving import Carving, carve
from tomo.hull.darkness import Brightness
from tomo.measurement import estimate_noise
from tomo.measurement.pixel_check import background
from tomo.scan.scan import Scan

COARSEST = 24
"""Voxels along each edge of the box in which light is looked for. Fewer: the box is wider than the
light by a voxel of them; more take longer."""


@dataclass(frozen=True, eq=False)
class Box:
    """A box, its corners ``(3,)``, and how it was found."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    reason: str
    cut: tuple[str, ...] = ()  # cameras with light at edges: it goes on beyond them


def box_of_light(scan: Scan, frames: Sequence[str]) -> Box:
    """Return the box around all that dark pixels do not prove empty in some whole frames.

    The search begins in a cube about the point where the axes meet, as wide as the widest field of
    view there. Its voxels are carved after a uniform background is taken off each image, and those
    are left that half as many cameras see as the most, two at least. The box around them is
    searched twice more by finer voxels, each time with one voxel more at each side, for emission
    that is fainter than carving's threshold.
    """
    point = point_in_view(scan.rig)
    if point is None:
        raise ValueError(
            f"{scan.where}grid: found cameras whose axes do not meet, expected the box to be "
            "given: --grid, --spacing and --center"
        )
    half = _reach(scan.rig, point)
    whole = point - half, point + half
    most = max(max(camera.image_size) for camera in scan.rig)
    small = scan.scaled(max(1, most // (4 * COARSEST)))  # a voxel is four pixels wide
    found: list[tuple[NDArray, NDArray]] = []
    carvings: list[Carving] = []
    cut: dict[str, None] = {}
    for frame in frames:
        images, masks = small.read(frame)
        clean = [_without_background(i, m) for i, m in zip(images, masks, strict=True)]
        noise = [estimate_noise(image, mask) for image, mask in zip(clean, masks, strict=True)]
        brightness = Brightness.of(clean, masks, 2.0, noise=noise)
        level = _certain(brightness)
        bounds = whole
        for _ in range(3):
            grid = VoxelGrid.from_bounds((COARSEST,) * 3, *bounds)
            carving = carve(tuple(small.rig), clean, masks, grid, threshold=level, noise=noise)
            bounds = _bounds(carving.active.mask & _in_view(small.rig, grid), grid, bounds)
        found.append(bounds)
        carvings.append(carving)
        cut |= dict.fromkeys(_cut_off(small.rig, brightness))
    lower = np.min([low for low, _ in found], axis=0)
    upper = np.max([high for _, high in found], axis=0)
    return Box(lower, upper, _reason(carvings, frames, len(scan.rig), point), tuple(cut))


def grid_in(rig: Rig, box: Box, voxel: float | None = None) -> tuple[VoxelGrid, int, RigCheck]:
    """Return the voxels that suit a box, by how much images may be shrunk, and the rig's check."""
    extent = box.upper - box.lower
    check = check_rig(rig, VoxelGrid.from_bounds((COARSEST,) * 3, box.lower, box.upper))
    sizes = [figures.footprint for figures in check.cameras if math.isfinite(figures.footprint)]
    pixel = float(np.median(sizes)) if sizes else float(extent.max()) / COARSEST
    edge = suitable_voxel(check, pixel) if voxel is None else voxel
    counts = np.ceil(np.round(extent / edge, 3)).astype(int)
    middle = np.round((box.lower + box.upper) / 2 / edge, 1) * edge + 0.0
    center = [float(f"{value:.9g}") for value in middle]
    grid = VoxelGrid(tuple(counts.tolist()), edge, tuple(center))
    return grid, shrinkable(pixel / edge) or 1, check


def _reach(rig: Rig, point: NDArray[np.float64]) -> float:
    """Return how far cameras see around a point, at most half of the way to the nearest."""
    reaches, distances = [], []
    for camera in rig:
        width, height = camera.image_size
        ends = [[(width - 1) / 2, (height - 1) / 2], [0, 0], [width - 1, 0]]
        ends += [[0, height - 1], [width - 1, height - 1]]
        origins, directions = camera.rays(np.array(ends, np.float64))
        cosines = directions[1:] @ directions[0]
        if np.isfinite(cosines).any():  # tables of rays may end inside the image
            distances.append(float(np.linalg.norm(origins[0] - point)))
            angle = float(np.arccos(np.clip(np.nanmin(cosines), 0.0, 1.0)))
            reaches.append(distances[-1] * math.tan(min(angle, math.pi / 4)))
    if not reaches:
        return float(min(np.linalg.norm(camera.position - point) for camera in rig)) / 2
    return min(max(reaches), min(distances) / 2)


def _without_background(image: NDArray, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return an image less its uniform background: the median of what is no brighter by noise."""
    noise = estimate_noise(image, mask)
    level = background(image, mask, noise)
    if level > 0:
        most = level + 3 * math.sqrt(float(noise.variance(level)))
        level = float(np.median(image[mask & (image <= most)]))
    return (image - level).astype(np.float32)


def _in_view(rig: Rig, grid: VoxelGrid) -> NDArray[np.bool_]:
    """Return which voxels half as many cameras see whole as the most do, and two at least."""
    edges = [
        low + step * np.arange(n + 1)
        for low, step, n in zip(grid.lower, grid.spacing, grid.shape, strict=True)
    ]
    points = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1).reshape(-1, 3)
    views = np.zeros(grid.shape, int)
    for camera in rig:
        uv, _, valid = camera.project(points)
        seen = (valid & camera.inside(uv)).reshape([n + 1 for n in grid.shape])
        for axis in range(3):
            first, second = (np.arange(n, grid.shape[axis] + n) for n in (0, 1))
            seen = np.take(seen, first, axis) & np.take(seen, second, axis)
        views += seen
    enough = max(min(2, len(rig)), -(-int(views.max()) // 2))
    return views >= enough


def _certain(brightness: Brightness) -> float | str:
    """Return the intensity from which pixels are certainly bright; ``auto`` where none is."""
    # a box is as large as its outermost voxels: noise above carving's threshold would widen it
    pairs = zip(brightness.images, brightness.certain, strict=True)
    lowest = [float(image[certain].min()) for image, certain in pairs if certain.any()]
    return min(lowest) if lowest else "auto"


def _cut_off(rig: Rig, brightness: Brightness) -> list[str]:
    """Return the cameras whose light reaches the edges of their images."""
    # a blur lessens the noise of an edge's pixel little: one inside must be bright too
    inside = 1 + math.ceil(3 * brightness.smoothing)
    found = []
    for name, certain in zip(rig.names, brightness.certain, strict=True):
        sides = (certain, certain[::-1], certain.T, certain.T[::-1])
        if any((side[0] & side[min(inside, len(side) - 1)]).any() for side in sides):
            found.append(name)
    return found


def _bounds(
    kept: NDArray[np.bool_], grid: VoxelGrid, before: tuple[NDArray, NDArray]
) -> tuple[NDArray, NDArray]:
    """Return the box around some voxels, one more at each side, inside an earlier box."""
    if not kept.any():
        return before
    at = np.argwhere(kept)
    lower = grid.lower + (at.min(axis=0) - 1) * grid.spacing
    upper = grid.lower + (at.max(axis=0) + 2) * grid.spacing
    return np.maximum(lower, before[0]), np.minimum(upper, before[1])


def _reason(
    carvings: Sequence[Carving], frames: Sequence[str], views: int, point: NDArray[np.float64]
) -> str:
    where = ", ".join(f"{value:g}" for value in point)
    moments = f"frame{'s' * (len(frames) > 1)} {', '.join(frames)}"
    if all(carving.active.all for carving in carvings):
        return (
            f"what the cameras see about ({where}), where their axes meet; the images of "
            f"{moments} make it no smaller: {carvings[0].reason}"
        )
    return (
        f"around the light of {moments} in {views} views: what dark pixels do not prove empty "
        f"about ({where}), where the cameras' axes meet"
    )
