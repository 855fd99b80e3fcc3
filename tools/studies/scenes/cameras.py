"""Rigs of small cameras around a grid: rings, two levels, half rings, domes, unlike or narrow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rigs import Camera, Distortion, Rig
from rigs.layouts import ring
from tomo import VoxelGrid

Size = tuple[int, int]

IMAGE_SIZES = ((80, 100), (96, 120), (96, 120), (64, 80), (80, 100))
"""By the seed, in turn: pixels are 0.45 to 1 voxels wide in the middle of the grid."""

DISTANCE = 150.0
"""Voxels between cameras and the grid's middle: rays of one camera are up to 15 degrees apart."""

ROOM = 1.08  # size of the region that an image shows, over the grid's outline
NARROW = 2.4
"""Focal length of every other camera of a rig of narrow views, over that of the others."""

GOLDEN_ANGLE = 137.50776405


def rig(name: str, grid: VoxelGrid, seed: int) -> Rig:
    """Return a rig by its kind and its number of views, such as ``dome-12``.

    All cameras look at the middle of the grid, of cubic voxels. The seed is that of the size of
    images, of where the first camera stands, and of differences of height.
    """
    kind, _, views = name.rpartition("-")
    if kind not in KINDS:
        raise ValueError(f"rig: found {name!r}, expected one of {', '.join(KINDS)}, and -VIEWS")
    size = IMAGE_SIZES[seed % len(IMAGE_SIZES)]
    return KINDS[kind](int(views), grid, size, np.random.default_rng([seed, int(views)]))


def _ring(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    return _around(grid, size, random, np.full(views, random.uniform(-5, 12)))


def _two_level(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    return _around(grid, size, random, np.where(np.arange(views) % 2, 32.0, -4.0))


def _half_ring(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    pitch, span = np.full(views, random.uniform(-5, 12)), 180.0 * (views - 1) / views
    return _around(grid, size, random, pitch, span / (views - 1))


def _dome(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    heights = np.sin(np.deg2rad(64)) * (np.arange(views) + 0.5) / views  # equal solid angles
    return _around(grid, size, random, np.rad2deg(np.arcsin(heights)), GOLDEN_ANGLE)


def _unlike(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    """Cameras of other distances, sizes, lenses and distortions; one sees a part of the grid."""
    near = _around(grid, size, random, random.uniform(-12, 35, views), distance=65.0)
    cameras = []
    for number, camera in enumerate(near):
        zoom = 1.9 if number == views // 2 else random.uniform(0.9, 1.2)
        cameras.append(_changed(camera, zoom, random.uniform(0.75, 1.2), random))
    return replace(near, cameras=tuple(cameras))


def _narrow(views: int, grid: VoxelGrid, size: Size, random: np.random.Generator) -> Rig:
    """Cameras of which every other one shows the middle of the grid alone."""
    rig = _ring(views, grid, size, random)
    near = [magnified(c, NARROW) if n % 2 else c for n, c in enumerate(rig)]
    return replace(rig, cameras=tuple(near))


def magnified(camera: Camera, times: float) -> Camera:
    """Return a camera whose lens has another focal length: marks lie ``times`` as far out."""
    matrix = np.array(camera.camera_matrix)
    matrix[[0, 1], [0, 1]] *= times
    return replace(camera, camera_matrix=matrix)


def _changed(camera: Camera, zoom: float, scale: float, random: np.random.Generator) -> Camera:
    """Return a camera with another lens and another sensor."""
    camera = magnified(camera.scaled(scale), zoom)
    matrix = np.array(camera.camera_matrix)
    matrix[:2, 2] += random.uniform(-1.5, 1.5, 2)
    lens = Distortion("brown", (random.uniform(-0.25, 0.1), 0.02, *random.uniform(-2e-3, 2e-3, 2)))
    return replace(camera, camera_matrix=matrix, distortion=lens)


def _around(
    grid: VoxelGrid,
    size: Size,
    random: np.random.Generator,
    pitch: np.ndarray,
    step: float | None = None,
    distance: float = DISTANCE,
) -> Rig:
    """Return cameras around the grid that show all of it; pitches ``(views,)`` in degrees."""
    views, voxel = len(pitch), grid.spacing[0]
    pitch = pitch + random.uniform(-2, 2, views)
    across = np.hypot(grid.extent[0], grid.extent[2])
    slope = np.deg2rad(np.abs(pitch).max())
    tall = grid.extent[1] * np.cos(slope) + across * np.sin(slope)
    nearer = 1 - max(across, tall) / 2 / (distance * voxel)  # what is near looks larger
    needed = max(across / size[0], tall / size[1]) * ROOM / nearer
    return ring(
        views,
        step,
        distance * voxel * random.uniform(0.97, 1.03, views),
        image_size=size,
        footprint=needed,
        pitch_degrees=pitch,
        start_degrees=random.uniform(0, 360),
        center=grid.center,
    )


KINDS: Mapping[str, Callable[[int, VoxelGrid, Size, np.random.Generator], Rig]] = {
    "ring": _ring,
    "two-level": _two_level,
    "half-ring": _half_ring,
    "dome": _dome,
    "unlike": _unlike,
    "narrow": _narrow,
}
