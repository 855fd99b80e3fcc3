"""Where rays enter and leave the grid's box, and the pixels of a camera that may see it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.rays.rays import Rays

if TYPE_CHECKING:
    from rigs import CameraLike

STILL = 1e-300
"""Voxels per length below which a ray is parallel to an axis: its reciprocal may be infinite.

Every tracer has to draw the line here: a ray in an outer face is inside while it is parallel, and
outside at once where it leaves however slowly.
"""


@dataclass(frozen=True, eq=False)
class BoxCrossing:
    """The part of every ray inside the box, in voxel units measured from the lower corner.

    Positions are taken at the entry, so that nothing depends on how far away the camera is:
    ``position + direction * t`` with ``0 <= t <= length``, ``t`` in world lengths.
    """

    position: NDArray[np.float64]  # (N, 3): where the ray enters
    direction: NDArray[np.float64]
    """Voxels per unit of world length, ``(N, 3)``; zero where the ray does not get from one
    floating-point position to the next: a rotation by 90 degrees leaves 6e-17, not zero."""
    length: NDArray[np.float64]  # (N,), in world lengths; zero for a ray that misses

    def first_voxel(self, shape: tuple[int, int, int]) -> NDArray[np.int64]:
        """Return the indices of the voxel that each ray moves into, ``(N, 3)``.

        On a face that is the voxel ahead; along a face the one above, or the last one.
        """
        below = np.where(self.direction < 0, np.ceil(self.position) - 1, np.floor(self.position))
        return np.clip(below, 0, np.asarray(shape) - 1).astype(np.int64)

    def planes_between(self, shape: tuple[int, int, int]) -> NDArray[np.int64]:
        """Return the number of planes strictly between each ray's entry and exit: (N,).

        A ray inside the box crosses one voxel more, fewer where it passes edges or corners.
        """
        ends = np.stack([self.position, self.position + self.direction * self.length[:, None]])
        ends = np.clip(ends, 0, shape)  # rounding leaves an end on an outer face just beyond it
        low, high = ends.min(axis=0), ends.max(axis=0)
        return np.maximum(np.ceil(high) - np.floor(low) - 1, 0).sum(axis=1).astype(np.int64)


def enter_box(rays: Rays, grid: VoxelGrid) -> BoxCrossing:
    """Clip every ray to the grid's box by the slab method.

    A ray parallel to an axis is inside that axis's slab when it lies between the two outer faces
    or on one of them. Written without ``0 * inf``: a component of `STILL` never divides.
    """
    position = grid.to_voxel_units(rays.origins)  # (N, 3)
    direction = rays.directions / grid.spacing  # (N, 3)
    shape = np.asarray(grid.shape, np.float64)
    parallel = np.abs(direction) < STILL
    divisor = np.where(parallel, 1.0, direction)
    to_lower = (0.0 - position) / divisor
    to_upper = (shape - position) / divisor
    between = (position >= 0) & (position <= shape)
    near = np.where(parallel, np.where(between, -np.inf, np.inf), np.minimum(to_lower, to_upper))
    far = np.where(parallel, np.where(between, np.inf, -np.inf), np.maximum(to_lower, to_upper))
    start = np.maximum(near.max(axis=1), 0.0)
    stop = np.minimum(far.min(axis=1), rays.lengths)
    inside = stop > start
    start = np.where(inside, start, 0.0)
    length = np.where(inside, stop - start, 0.0)
    position = position + direction * start[:, None]
    still = position + direction * length[:, None] == position
    return BoxCrossing(position, np.where(still, 0.0, direction), length)


_RAYS_AT_ONCE = 2**19
"""Rays tested at once: bounds the working memory to some 100 MB."""


def pixels_that_see(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.int64]:
    """Return, ascending, the pixels ``row * width + column`` whose area may see the grid's box.

    Those whose central ray meets the box grown by ``D tan(a) + b``, where ``D`` is the distance to
    its farthest corner, and ``a`` and ``b`` bound the angle and the distance between a pixel's
    central ray and those at its corners: none that sees it is lost, some that miss it narrowly
    stay.
    """
    if not camera.is_straight:  # its pieces may see the box one behind the other
        return np.arange(math.prod(camera.image_size))
    origins, directions = camera.rays()
    width = camera.image_size[0]
    known = np.flatnonzero(np.isfinite(directions).all(axis=1))
    if not len(known):
        return known
    angle = _largest_step(directions, width)  # to the corners: 0.71 of a step
    if angle >= 1.0:  # neighbours that have nothing to do with each other
        return known
    apart = _largest_step(np.where(np.isfinite(directions), origins, np.nan), width)
    corners = np.stack(np.meshgrid(*zip(grid.lower, grid.upper, strict=True)), -1).reshape(-1, 3)
    ends = origins[known].min(axis=0), origins[known].max(axis=0)
    away = np.maximum(np.abs(corners - ends[0]), np.abs(corners - ends[1]))
    margin = np.linalg.norm(away, axis=1).max() * math.tan(angle) + apart
    grown = VoxelGrid((1, 1, 1), tuple(grid.extent + 2 * margin), grid.center)
    kept = []
    for start in range(0, len(known), _RAYS_AT_ONCE):
        some = known[start : start + _RAYS_AT_ONCE]
        crossing = enter_box(Rays.from_lines(origins[some], directions[some]), grown)
        kept.append(some[crossing.length > 0])
    return np.concatenate([np.zeros(0, np.int64), *kept])


def pixels_of_hardware(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.bool_]:
    """Return from which pixels hardware hides the grid, ``(height, width)``.

    Their lines of sight end without having met the grid, and would meet it if they went on.
    """
    width, height = camera.image_size
    hidden = np.zeros(width * height, bool)
    if not camera.is_straight:
        inside, pixels = camera.paths(region=np.stack([grid.lower, grid.upper]))
        ended = (inside.ends != 0) & (np.diff(inside.ray_ptr) == 0)
        column, row = pixels[ended] % width, pixels[ended] // width
        whole, _ = camera.paths(np.stack([column, row], axis=1).astype(np.float64))
        last = whole.ray_ptr[1:] - 1
        onward = Rays.from_lines(whole.origins[last], whole.directions[last])
        hidden[pixels[ended]] = enter_box(onward, grid).length > 0
    return hidden.reshape(height, width)


def _largest_step(vectors: NDArray[np.float64], width: int) -> float:
    """Return the largest distance between the vectors ``(pixels, 3)`` of neighbouring pixels."""
    image = vectors.reshape(-1, width, 3)
    steps = [np.diff(image, axis=axis).reshape(-1, 3) for axis in (0, 1)]
    squares = np.concatenate([np.einsum("ij,ij->i", step, step) for step in steps])
    return math.sqrt(np.nanmax(squares, initial=0.0))
