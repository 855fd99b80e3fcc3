"""What an encoder sees of a segment: places and directions, in the paper's form and in others."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators.stored import Projector
from tomo.trace import Segments

OPTICS = (
    "direction, x",
    "direction, y",
    "direction, z",
    "position in the image, across",
    "position in the image, up",
    "position in the image, across squared",
    "position in the image, up squared",
    "depth in the grid",
    "upstream emission",
)
"""The features that optics depend on, none of them the segment's place in the world."""

IDENTIFYING = {"gain": OPTICS[:3], "absorption": OPTICS[7:]}
"""The features by which an encoder would imitate an effect: directions tell which camera looks,
the way that light has gone tells what absorbs it."""

INPUTS = {"absolute": 6, "relative": 6, "optics": len(OPTICS)}
"""What an encoder may see, and how many numbers a segment that is."""

_SHORTEST_RUN = 1e-3
"""Fraction of the longest run of midpoints. A shorter run gives no direction: single-precision
midpoints would turn it by more than a milliradian. A larger bound drops pixels at the grid's
edges."""


@dataclass(frozen=True, eq=False)
class RayFeatures:
    """The numbers that describe rays and their segments to an encoder.

    - ``absolute``, the paper's: the voxel's index and the segment's midpoint, both counted in
      voxels from the grid's middle, over half the voxels along the longest axis.
    - ``relative``: twice the midpoint's place in its voxel, in voxels from the voxel's centre,
      which is a linear function of the absolute ones, and the ray's direction.
    - ``optics``: direction of the ray; position in the image, as the tangents of the angles from
      the view's mean direction over ``image_scale``; their squares; depth in the grid as seen
      from the camera, from -1 to 1 over its shortest edge; upstream emission (zero until
      `Rays.with_upstream` fills it).

    An encoder that sees where a voxel lies can hide a smooth factor in the weights and its inverse
    in the voxels while the loss still falls. One that sees where a ray cuts a voxel imitates what
    voxels are too coarse for.

    Attributes
    ----------
    of_ray : (rays, a) float32
    of_segment : (S, b) float32
    image_scale : float
        The largest tangent among the rays that an encoder is trained on.
    """

    of_ray: torch.Tensor
    of_segment: torch.Tensor
    image_scale: float = 1.0

    @classmethod
    def of(
        cls,
        projector: Projector,
        inputs: str,
        *,
        device: torch.device | str = "cpu",
        image_scale: float | None = None,
    ) -> RayFeatures:
        """Return the features of a stored projector, its segments with midpoints."""
        if inputs not in INPUTS:
            raise ValueError(f"inputs: found {inputs!r}, expected one of {', '.join(INPUTS)}")
        scale, direction = 1.0, np.zeros((projector.shape[0], 0))
        if inputs != "absolute":
            # View by view: a pixel without a direction of its own takes that of a neighbour.
            parts = [projector.view(number).segments for number in range(projector.n_views)]
            direction = np.concatenate([ray_directions(part) for part in parts])
        of_ray = direction
        if inputs == "optics":
            position = _image_positions(direction, projector.view_ptr)
            scale = float(np.abs(position).max()) or 1.0 if image_scale is None else image_scale
            position /= scale
            of_ray = np.column_stack([direction, position, position**2])
            depth = _depths(projector, direction)
            of_segment: NDArray = np.column_stack([depth, np.zeros_like(depth)])
        else:
            of_segment = _places(projector, inputs == "relative")

        def move(array: NDArray) -> torch.Tensor:
            return torch.tensor(array.astype(np.float32), device=device)

        return cls(move(of_ray), move(of_segment), scale)

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        width = self.of_ray.shape[1] + self.of_segment.shape[1]
        return f"<RayFeatures: {width} numbers a segment>"

    def of_segments(self, segment: torch.Tensor, ray: torch.Tensor) -> torch.Tensor:
        """Return the features of some segments, ``(E, F)``: their numbers, and those of rays."""
        of_ray = self.of_ray.index_select(0, ray)  # several times faster than of_ray[ray]
        return torch.cat([of_ray, self.of_segment.index_select(0, segment)], dim=1)

    def with_column(self, column: int, values: torch.Tensor) -> RayFeatures:
        """Return the features with ``values`` (S,) in a column of those of segments."""
        changed = self.of_segment.clone()
        changed[:, column] = values.to(changed)
        return replace(self, of_segment=changed)

    def to(self, device: torch.device | str) -> RayFeatures:
        """Return the same features on another device."""
        return replace(self, of_ray=self.of_ray.to(device), of_segment=self.of_segment.to(device))


def ray_directions(segments: Segments) -> NDArray[np.float64]:
    """Return the unit vector from each pixel's first segment to its last: ``(pixels, 3)``.

    Segments come in the order of travel, so the vectors point away from the camera. A pixel with
    segments too near one another, or one alone, takes the nearest pixel's direction; zeros if
    none.
    """
    first, last = segments.ptr[:-1], np.maximum(segments.ptr[1:] - 1, segments.ptr[:-1])
    directions = np.zeros((segments.n_pixels, 3))  # (pixels, 3)
    nonempty = np.flatnonzero(np.diff(segments.ptr))
    if not len(nonempty):
        return directions
    run = segments.midpoint[last[nonempty]].astype(np.float64)
    run -= segments.midpoint[first[nonempty]]
    length = np.linalg.norm(run, axis=1)
    known = np.flatnonzero((length > _SHORTEST_RUN * length.max(initial=0.0)) & (length > 0))
    if not len(known):
        return directions
    pixel = nonempty[known]
    unit = run[known] / length[known, None]
    right = np.clip(np.searchsorted(pixel, np.arange(segments.n_pixels)), 0, len(pixel) - 1)
    left = np.maximum(right - 1, 0)
    number = np.arange(segments.n_pixels)
    nearer_left = np.abs(number - pixel[left]) < np.abs(pixel[right] - number)
    return unit[np.where(nearer_left, left, right)]


def _places(projector: Projector, relative: bool) -> NDArray[np.float32]:
    """Return the place of each segment in its voxel, ``(S, 3)``, or index and midpoint, (S, 6)."""
    grid, segments = projector.grid, projector.segments
    half = max(grid.shape) / 2
    midpoint = segments.midpoint / np.asarray(grid.spacing) / half  # from the grid's centre
    index = _indices(grid, projector.active)[segments.voxel] / half
    if relative:
        return ((midpoint - index) * (2 * half)).astype(np.float32)
    return np.hstack([index, midpoint]).astype(np.float32)


def _indices(grid: VoxelGrid, active: ActiveVoxels) -> NDArray[np.float64]:
    """Return the index of every unknown from the grid's middle, ``(unknowns, 3)``."""
    axes = [np.arange(n) - (n - 1) / 2 for n in grid.shape]
    index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return index if active.index is None else index[active.index]


def _depths(projector: Projector, direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how deep in the grid segments are: -1 where rays enter, 1 a shortest edge on."""
    grid, segments = projector.grid, projector.segments
    half = (np.asarray(grid.upper) - np.asarray(grid.lower)) / 2
    first = segments.midpoint[np.minimum(segments.ptr[:-1], len(segments) - 1)]
    entry = _entry_distances(first.astype(np.float64), direction, half)
    count = np.diff(segments.ptr)
    way = np.repeat(direction.astype(np.float32), count, axis=0)
    along = np.einsum("si,si->s", segments.midpoint, way)
    return (along - np.repeat(entry, count)) / half.min() - 1


def _entry_distances(
    point: NDArray[np.float64], direction: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where along ``direction`` rays through ``point`` enter the box ``±half``: (rays,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        back = (point + np.where(direction > 0, half, -half)) / direction  # (rays, 3)
    back = np.where(direction == 0, np.inf, back).min(axis=1)
    back = np.where(np.isfinite(back), back, 0.0)
    return (point * direction).sum(axis=1) - back


def _image_positions(
    direction: NDArray[np.float64], view_ptr: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the tangents of each ray's angles from its view's mean direction, ``(rays, 2)``."""
    position = np.zeros((len(direction), 2))
    for start, stop in itertools.pairwise(view_ptr):
        own = direction[start:stop]
        mean = own.sum(axis=0)
        if not np.linalg.norm(mean) > 0:
            continue
        mean /= np.linalg.norm(mean)
        up = np.eye(3)[1] if abs(mean[1]) < 0.9 else np.eye(3)[2]
        across = np.cross(mean, up)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(mean, across)], axis=1)  # (3, 2)
        position[start:stop] = (own @ axes) / np.maximum(own @ mean, 0.1)[:, None]
    return position
