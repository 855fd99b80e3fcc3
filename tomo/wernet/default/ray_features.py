"""The features of a segment that the default encoder sees, none of them its place in the world."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.packing import Packing
from tomo.wernet.ray_directions import ray_directions

FEATURES = (
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

IDENTIFYING = {"gain": FEATURES[:3], "absorption": FEATURES[7:]}
"""The features by which an encoder would imitate an effect: directions tell which camera looks,
the way that light has gone tells what absorbs it."""


@dataclass(frozen=True, eq=False)
class RayFeatures:
    """The segments of a projector's rays, and the features that describe each to the encoder.

    An encoder that sees where a voxel lies can hide a smooth factor in the weights and its inverse
    in the voxels while the loss still falls. One that sees where a ray cuts a voxel imitates what
    voxels are too coarse for. The features are therefore those that optics depend on:

    - direction of the ray,
    - position in the image: the tangents of the angles from the view's mean direction, in units
      of ``image_scale``, and their squares,
    - depth in the grid as seen from the camera, from -1 to 1 over the grid's shortest edge,
    - upstream emission: the light between the segment and the camera.

    Attributes
    ----------
    start, count : (rays,) int64
        First segment and number of segments of each ray.
    of_ray : (rays, 7) float32
        Direction, position in the image, and its squares.
    depth : (S,) float32
    length : (S,) float32
    voxel : (S,) integer
        The unknown that each segment crosses.
    shortest_edge : float
        The grid's.
    image_scale : float
        The largest tangent among the training rays.
    """

    start: torch.Tensor
    count: torch.Tensor
    of_ray: torch.Tensor
    depth: torch.Tensor
    length: torch.Tensor
    voxel: torch.Tensor
    shortest_edge: float
    image_scale: float

    @classmethod
    def of(
        cls,
        projector: Projector,
        device: torch.device | str = "cpu",
        *,
        image_scale: float | None = None,
    ) -> RayFeatures:
        """Return the features of a stored projector whose segments have midpoints.

        Parameters
        ----------
        projector : Projector
        device : torch.device or str
        image_scale : float, optional
            That of the rays that weights were learned from; that of these rays when None.

        Raises
        ------
        ValueError
            If the segments have no midpoints, or there is none.
        """
        rays, grid = projector.without_blur, projector.grid
        segments = rays.segments
        if segments.midpoint is None:
            raise ValueError(
                "segments midpoint: found none, expected (S, 3): trace with midpoints=True"
            )
        if len(segments) == 0:
            raise ValueError("segments: found none, expected at least one ray through the grid")
        # View by view: a pixel without a direction of its own takes that of a neighbour.
        direction = np.concatenate(
            [ray_directions(rays.view(v).segments) for v in range(rays.n_views)]
        )
        position = _image_positions(direction, rays.view_ptr)
        scale = float(np.abs(position).max()) or 1.0 if image_scale is None else image_scale
        position /= scale
        half = (np.asarray(grid.upper) - np.asarray(grid.lower)) / 2
        first = segments.midpoint[np.minimum(segments.ptr[:-1], len(segments) - 1)]
        entry = _entry_distances(first.astype(np.float64), direction, half)
        count = np.diff(segments.ptr)
        way = np.repeat(direction.astype(np.float32), count, axis=0)
        along = np.einsum("si,si->s", segments.midpoint, way)
        depth = (along - np.repeat(entry, count)) / half.min() - 1

        def move(array: NDArray, kind: type = np.float32) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(array, kind)).to(device)

        return cls(
            start=move(segments.ptr[:-1], np.int64),
            count=move(count, np.int64),
            of_ray=move(np.column_stack([direction, position, position**2])),
            depth=move(depth),
            length=move(segments.length),
            voxel=move(segments.voxel, segments.voxel.dtype.type),
            shortest_edge=float(2 * half.min()),
            image_scale=scale,
        )

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<RayFeatures: {len(self.start)} rays, {len(self.voxel)} segments>"

    def packed(self, rays: torch.Tensor, upstream: torch.Tensor) -> tuple[Packing, torch.Tensor]:
        """Return the packing of some rays and the features of their segments: ``(E, features)``.

        Parameters
        ----------
        rays : (B,) int64
            Each with at least one segment.
        upstream : (S,) float32
            Upstream emission of all segments, see `upstream_emission`.
        """
        packing = Packing.of(self.start[rays], self.count[rays])
        of_segment = torch.stack([self.depth, upstream], dim=1)[packing.segment]
        return packing, torch.cat([packing.per_segment(self.of_ray[rays]), of_segment], dim=1)

    def upstream_emission(self, volume: NDArray[np.float32], unit: float) -> torch.Tensor:
        """Return the emission between the camera and each segment's middle: ``(S,)`` float32.

        It is the sum of ``length x volume`` along the ray up to there, half of the segment's own
        included, over ``unit``.

        Parameters
        ----------
        volume : (unknowns,) float32
        unit : float
            A typical pixel; above zero.
        """
        count, voxel, length = (
            each.cpu().numpy() for each in (self.count, self.voxel, self.length)
        )
        own = length * volume[voxel].astype(np.float64)
        behind = np.concatenate([[0.0], np.cumsum(own)])  # over the segments of all rays
        first = behind[self.start.cpu().numpy()]
        upstream = (behind[:-1] + own / 2 - np.repeat(first, count)) / unit
        return torch.from_numpy(upstream.astype(np.float32)).to(self.length.device)


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
