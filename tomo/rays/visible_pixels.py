"""The pixels of a camera that may see a box, and those that see hardware alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.rays.ray_box import enter_box
from tomo.rays.rays import Rays

if TYPE_CHECKING:
    from rigs import CameraLike

_RAYS_AT_ONCE = 2**19
"""Rays tested at once: bounds the working memory to some 100 MB."""


def pixels_that_see(camera: CameraLike, grid: VoxelGrid) -> NDArray[np.int64]:
    """Return, ascending, the pixels ``row * width + column`` whose area may see the grid's box.

    Notes
    -----
    A pixel is kept when its central ray meets the box grown by ``D tan(a) + b``, where ``D`` is
    the distance to the box's farthest corner, and ``a`` and ``b`` bound the angle and the distance
    between a pixel's central ray, where it begins, and those at its corners: none that sees the
    box is lost, some that miss it narrowly stay.
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
